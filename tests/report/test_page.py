"""The report's page without a browser: its structure, its escaping, its size, and its figures and findings."""

import json
from html.parser import HTMLParser
from itertools import pairwise
from xml.etree import ElementTree

import numpy as np
import pytest

from rsdeblur import Camera, Exposure, GyroLog, OutputError, PsfBank, triage
from rsdeblur.report import drawings, psf_map, side_by_side
from rsdeblur.report.drawings import LONG_SIDE, TITLE, timeline_svg
from rsdeblur.report.facts import motion_data
from rsdeblur.report.page import render, write_page

# Every way out of an element, an attribute, a comment, JSON and a template.
HOSTILE = (
    """</script><script>alert(1)</script><!-- <img src=x onerror="alert(2)"> ' " & $title ${data} \u2028 ]]> </title>"""
)
VOID = {"meta", "img", "input", "br", "link"}


class Outline(HTMLParser):
    """Collects elements, and checks that they are closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: dict[str, list[str]] = {}
        self._open: list[str] = []
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        for tag in self._open[-1:]:
            self.texts.setdefault(tag, []).append(data)

    def attributes(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]


def test_the_page_is_whole_and_accessible(report_page) -> None:
    outline = Outline(render(report_page()))
    ids = [attributes["id"] for _, attributes in outline.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    assert outline.attributes("html")[0]["lang"] == "en"
    assert any(attributes.get("name") == "viewport" for attributes in outline.attributes("meta"))
    assert [attributes["alt"] for attributes in outline.attributes("img")] == ["input", "global", "banded"]
    named = {attributes.get("aria-label") for _, attributes in outline.elements}
    assert "Swap left and right" in named
    for _, attributes in outline.elements:
        for reference in ("aria-labelledby", "aria-describedby", "for"):
            assert attributes.get(reference, ids[0]) in ids
    columns = outline.texts["th"]
    assert {"mode", "time s", "global", "banded"} <= set(columns)
    assert "Recording" in outline.texts["h3"]


def test_the_best_result_and_its_verdict_come_first(report_page) -> None:
    page = report_page()

    def judged(**verdicts) -> str:
        check = page.report["modes"]["banded"]["check"]
        modes = {
            mode: page.report["modes"][mode] | {"check": check | {"verdict": verdict}}
            for mode, verdict in verdicts.items()
        }
        return render(page._replace(report=page.report | {"modes": modes}))

    text = judged(**{"global": "good", "banded": "doubtful"})
    assert 'global: <span class="verdict good">good</span>' in text
    assert '"best":"global"' in text.replace(" ", "")
    # Of equal verdicts, the later mode.
    assert 'banded: <span class="verdict warning">bad</span>' in judged(**{"global": "bad", "banded": "bad"})
    unknown = dict.fromkeys(("global", "banded"), "cannot tell")
    assert 'banded: <span class="verdict note">cannot tell</span>' in judged(**unknown)


def test_nothing_is_fetched_and_no_foreign_script_may_run(report_page) -> None:
    text = render(report_page())
    outline = Outline(text)
    for _, attributes in outline.elements:
        for source in ("src", "href"):
            assert attributes.get(source, "#").startswith(("data:", "#"))
        assert not any(name.startswith("on") or name == "style" for name in attributes)
    assert "url(" not in text
    (policy,) = (a["content"] for a in outline.attributes("meta") if "http-equiv" in a)
    assert policy.startswith("default-src 'none'")
    assert "unsafe" not in policy


def test_foreign_text_stays_text(report_page) -> None:
    # A name contains no slash.
    name = HOSTILE.replace("/", ":")
    page, tame = report_page(photo=name, remark=HOSTILE), report_page(remark="harmless")
    page = page._replace(
        report=page.report | {"modes": {HOSTILE: page.report["modes"]["banded"]}},
        banks={HOSTILE: page.banks["global"]},
        shown={"a": page.shown["input"], HOSTILE: page.shown["global"]},
        settings={HOSTILE: {HOSTILE: HOSTILE}},
    )
    outline = Outline(render(page))
    # No element and no attribute beyond those of a harmless page.
    assert {tag for tag, _ in outline.elements} == {tag for tag, _ in Outline(render(tame)).elements}
    assert len(outline.attributes("script")) == 2
    assert outline.texts["title"] == [f"{name} · rsdeblur report"]
    assert outline.texts["dd"] == [HOSTILE]
    assert HOSTILE in outline.texts["th"]
    data = json.loads("".join(outline.texts["script"][:1]))
    assert list(data["banks"]) == [HOSTILE]


def test_a_name_that_is_no_unicode_is_replaced(report_page, tmp_path) -> None:
    write_page(tmp_path / "report.html", report_page(photo="b\udcffd.png"))
    assert '<h1 id="title">b?d.png</h1>' in (tmp_path / "report.html").read_text("utf-8")
    with pytest.raises(OutputError, match="cannot write"):
        write_page(tmp_path / "no" / "report.html", report_page())


def test_large_pictures_are_reduced_alike_until_they_fit(monkeypatch) -> None:
    noise = np.random.default_rng(0).random((300, 400, 3), dtype=np.float32)
    pictures = {"a": noise, "b": noise / 2}
    assert drawings.picture_uris(pictures, None)[1] == 1.0
    monkeypatch.setattr(drawings, "PAGE_PIXELS", 2 * 400 * 300 / 16)
    uris, scale = drawings.picture_uris(pictures, None)
    assert scale == 0.25
    assert all(uri.startswith("data:image/jpeg;base64,") for uri in uris)


@pytest.mark.parametrize("direction", ["top-down", "right-left"])
def test_the_plot_shows_camera_axes_and_each_lines_window(shaky_log, direction) -> None:
    log = shaky_log()
    camera = Camera(
        80, 60, 100.0, readout_time=0.03, readout_direction=direction, imu_to_camera="phone-portrait", time_offset=0.02
    )
    epoch = 1_700_000_000_000_000_000
    data = motion_data(GyroLog(log.t, log.omega, epoch), camera, Exposure(0.15, 0.04, epoch))
    lines = 60 if direction == "top-down" else 80
    last = 30 * (lines - 1) / lines
    # The exposure lasts 70 ms less one line; half of that is shown on either side.
    assert data["t"][0] == pytest.approx(-35, abs=6)
    assert data["lines"] == lines
    assert data["opens"] == pytest.approx([0.0, last] if direction == "top-down" else [last, 0.0], abs=1e-4)
    i = np.argmin(np.abs(log.t + 0.02 - 0.15 - 1e-3 * data["t"][0]))
    # Rates are rounded to six digits.
    np.testing.assert_allclose(np.array(data["rates"])[:, 0], camera.imu_to_camera @ log.omega[i], atol=1e-6)


def test_findings_are_remarks_and_verdicts(report_page) -> None:
    page = report_page(remark="slow gyro")
    assert page.findings == [("Warning", "slow gyro"), ("Check, banded", "doubtful. Ringing.")]


def bank(bands: int, strips: int, size: tuple[int, int] = (9, 15)) -> PsfBank:
    """Return kernels that are bars along x, at the tile centres of a picture of 120x160."""
    kernels = np.zeros((bands, strips, *size), np.float32)
    kernels[:, :, size[0] // 2, 1:-1] = 1.0 / (size[1] - 2)
    return PsfBank.for_picture(kernels, (120, 160))


@pytest.mark.parametrize(("bands", "strips"), [(1, 1), (5, 8), (16, 1), (64, 8)])
def test_psf_map_draws_within_its_cells(bands: int, strips: int) -> None:
    drawing = psf_map(bank(bands, strips), (120, 160))
    height = LONG_SIDE * 120 // 160
    assert drawing.shape == (height + TITLE, LONG_SIDE, 3)
    assert drawing.dtype == np.float32
    assert drawing.min() >= 0.0
    assert drawing.max() <= 1.0
    red = drawing[:height, :, 0] > 0.6
    # Each strip's kernel leaves the borders of its cell free, so kernels never touch.
    borders = np.linspace(0, LONG_SIDE, strips + 1).round().astype(int)
    assert not red[:, np.clip(borders, 0, LONG_SIDE - 1)].any()
    for left, right in pairwise(borders):
        assert red[:, left:right].any()


def test_psf_map_dims_the_picture_below() -> None:
    drawing = psf_map(bank(1, 1), (120, 160), picture=np.ones((120, 160), np.float32))
    assert 0.2 < drawing[5, 5].mean() < 0.5


def test_side_by_side_shows_each_picture_in_its_column() -> None:
    grey = np.full((60, 80), 0.25, np.float32)
    sheet = side_by_side({"dark": grey, "light": np.dstack([grey * 3] * 3)})
    assert sheet.ndim == 3
    half = sheet.shape[1] // 2
    assert np.median(sheet[100:400, 100 : half - 100]) == pytest.approx(0.25, abs=1 / 255)
    assert np.median(sheet[100:400, half + 100 : -100]) == pytest.approx(0.75, abs=1 / 255)


def test_the_timeline_has_a_dot_for_each_exposure() -> None:
    exposures = [Exposure(0.2, 0.01), Exposure(1.2, 0.1), Exposure(5.0, 0.1)]
    t, camera = np.arange(0.0, 2.0, 0.005), Camera(160, 120, 400.0)
    # A turn of 1 rad/s about the y axis until 1 s, then rest.
    log = GyroLog(t, np.where(t < 1.0, 1.0, 0.0)[:, None] * [0.0, 1.0, 0.0])
    root = ElementTree.fromstring(timeline_svg([0.0, 1.0, None], triage(log, camera, exposures)))
    dots = [dot for dot in root.iter() if dot.tag.endswith("circle") and dot.get("r") == "3.5"]
    assert len(dots) == 2
    # Inside the frame, from 56 to 944 px.
    assert 60 < float(dots[0].get("cx")) < float(dots[1].get("cx")) < 940
    # Higher is more.
    assert float(dots[0].get("cy")) < float(dots[1].get("cy"))
    # Nothing to draw is no error.
    ElementTree.fromstring(timeline_svg([], triage(log, camera, [])))
