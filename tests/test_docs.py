"""The documentation: commands run as printed, and links have targets; darktable's export target, run by Lua."""

import json
import re
import shlex
import shutil
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner

import rsdeblur
from benchmarks.tutorials import BLOCK, Step, steps
from rsdeblur import Correction
from rsdeblur._util import workers
from rsdeblur.cli import main
from rsdeblur.estimate import Refinement

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(page for page in [*ROOT.glob("*.md"), *DOCS.rglob("*.md")] if "generated" not in page.parts)
# Pages that follow each other, on the same files.
WALKTHROUGH = ("tutorials/logger-apps.md", "good-data.md", "tutorials/own-kernels.md")


def commands(page: Path) -> list[str]:
    """Return the commands in the shell blocks of a page."""
    return [step.text for step in steps(page) if step.language == "sh"]


def slug(heading: str) -> str:
    """Return the anchor of a heading, as code hosts and the site form it."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


def follow(step: Step, size: str) -> None:
    """Run a step of a page in this process, on a smaller picture, which tests the same in a fraction of the time."""
    if step.needs:
        return
    if step.language == "python":
        exec(compile(step.text, "page", "exec"), {})
    elif not step.text.startswith("rsdeblur "):
        subprocess.run(step.text, shell=True, check=True)
    else:
        words = shlex.split(re.sub(r"--size \d+x\d+(?= -o s)", f"--size {size}", step.text.replace("\\\n", "")))[1:]
        result = CliRunner().invoke(main, words, catch_exceptions=False)
        assert (result.exit_code != 0) == step.is_refused, f"{step.text}: {result.stderr}"
        assert "warning" not in result.stderr


@pytest.fixture(autouse=True)
def unrefined(monkeypatch: pytest.MonkeyPatch) -> None:
    """Refine at once: what a picture says of its recording has its own tests."""

    def refine(_: object, log: Any, camera: Any, exposure: Any, **__: object) -> Refinement:
        return Refinement(log, camera, exposure, None, False, "", Correction(), Correction(), 0.0, 0.0, 0.0)

    monkeypatch.setattr("rsdeblur.pipeline.plan.refine", refine)


def test_the_commands_of_the_walkthrough_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    # A step that an earlier page has too runs once.
    for step in dict.fromkeys(step for page in WALKTHROUGH for step in steps(DOCS / page)):
        # A small picture does not determine the offset; tests/cli/test_commands.py has one that does.
        if not step.text.startswith("rsdeblur sync "):
            follow(step, "120x96")
    assert {"mine.png", "kernels.png", "report.html"} <= {file.name for file in tmp_path.glob("shot/*")}
    assert (tmp_path / "python.png").stat().st_size > 0
    assert rsdeblur.read_camera(tmp_path / "phone.toml").readout_time == 0.0056


def test_the_first_page_finds_the_moment_of_its_photo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    page = DOCS / "tutorials/first-photo.md"
    results = [CliRunner().invoke(main, shlex.split(line)[1:], catch_exceptions=False) for line in commands(page)]
    assert [result.exit_code for result in results] == [0, 0]
    found, printed = (re.findall(r"began (.*) s before", text) for text in (results[1].stdout, page.read_text("utf-8")))
    # 5 ms are a tenth of the exposure: a trail that is shifted by so much is still nearly that of the photo.
    assert [float(seconds) for seconds in found] == pytest.approx([float(printed[0])], abs=0.005)


def test_the_page_of_many_photos_can_be_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """``python -m benchmarks.tutorials`` follows all pages as printed."""
    monkeypatch.chdir(tmp_path)

    def in_this_process(work, tasks, **_):  # saves the start of workers
        for task in tasks:
            yield task, workers.attempt(work, task)

    monkeypatch.setattr(workers, "run", in_this_process)
    for step in steps(DOCS / "tutorials/many-photos.md"):
        follow(step, "80x64")
    assert (tmp_path / "session-sharp/frame0003.png").stat().st_size > 0


def test_the_python_of_the_readme_runs_without_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    blocks = BLOCK.findall((ROOT / "README.md").read_text(encoding="utf-8"))
    code = [content for language, content in blocks if language == "python"]
    names: dict[str, Any] = {}
    for content in code:
        small = content.replace("640, 480, 700", "160, 120, 175").replace("scene(608, 768)", "scene(152, 192)")
        exec(compile(small, "README.md", "exec"), names)
    assert names["sharp"].shape == names["blurred"].shape


@cache
def prose(page: Path) -> str:
    """Return a page without its blocks of code."""
    return BLOCK.sub("", page.read_text(encoding="utf-8"))


def test_links_lead_somewhere() -> None:
    links = [(page, link) for page in PAGES for link in re.findall(r"\]\(([^)\s]+)\)", prose(page))]
    for page, link in links:
        if re.match(r"[a-z]+:", link):
            continue
        target, _, anchor = link.partition("#")
        file = (page.parent / target) if target else page
        assert file.exists(), f"{page}: {link}"
        if anchor:
            headings = re.findall(r"^#+ (.*)$", prose(file), re.MULTILINE)
            assert anchor in map(slug, headings), f"{page}: {link}"


def test_options_are_those_of_the_commands() -> None:
    lines = [(page, line) for page in PAGES for line in commands(page) if line.startswith("rsdeblur ")]
    for page, line in lines:
        words = line.replace("\\\n", " ").split()[1:]
        command: click.Command = main
        context = click.Context(main)
        while isinstance(command, click.Group):
            found = command.get_command(context, words.pop(0))
            assert found is not None, f"{page}: {line}"
            command = found
        known = {option for parameter in command.params for option in parameter.opts}
        assert {word.split("=")[0] for word in words if re.match("--?[a-z]", word)} <= known, f"{page}: {line}"


SCRIPT = Path(__file__).resolve().parents[1] / "contrib" / "darktable" / "rsdeblur.lua"
# Everything of darktable's interface that the script uses. `fields` are the texts of the entries, in order.
STAND_IN = """
local said, imported, entries = {}, {}, {}
local storage
package.preload["darktable"] = function()
  return {
    print = function(text) said[#said + 1] = text end,
    print_log = function() end,
    control = { execute = function(command) return select(3, os.execute(command)) end },
    database = { import = function(path)
      imported[#imported + 1] = path
      return { group_with = function() end }
    end },
    preferences = { read = function() return "" end, write = function() end },
    new_widget = function(kind) return function(widget)
      if kind == "entry" then entries[#entries + 1] = widget end
      return widget
    end end,
    register_storage = function(...) storage = { ... } end,
  }
end
dofile(arg[1])
local folder, program, rendered = arg[2], arg[3], arg[4]
entries[1].text = program
entries[4].text = "--capture '$(FOLDER)/my frames.csv' --index 4"
entries[5].text = '--mode "row wise"; echo $HOME `id`'
storage[4](nil, { [{ filename = "it's $(id).raw", path = folder }] = rendered }, nil)
for _, path in ipairs(imported) do print(path) end
for _, text in ipairs(said) do print(text) end
"""


@pytest.mark.skipif(shutil.which("lua5.4") is None, reason="lua5.4 is not installed")
def test_darktable_calls_deblur_without_a_shell_reading_names_or_options(tmp_path):
    folder = tmp_path / "photos"
    folder.mkdir()
    rendered, words = tmp_path / "rendered.jpg", tmp_path / "words.json"
    for file in (rendered, folder / "gyro.csv", folder / "camera.toml", folder / "it's $(id)-sharp.jpg"):
        file.write_text("")
    program = tmp_path / "rs deblur"
    program.write_text(
        "#!/usr/bin/env python3\nimport json, sys\n"
        f"json.dump(sys.argv[1:], open({str(words)!r}, 'w'))\nopen(sys.argv[-1], 'x').close()\n"
    )
    program.chmod(0o755)
    (tmp_path / "run.lua").write_text(STAND_IN)
    command = ["lua5.4", tmp_path / "run.lua", SCRIPT, folder, program, rendered]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
    # The first free name beside the original.
    output = folder / "it's $(id)-sharp-2.jpg"
    assert done.stdout.splitlines() == [str(output), "rsdeblur: 1 of 1 photos restored"]
    assert json.loads(words.read_text()) == [
        *("deblur", str(rendered), "--gyro", str(folder / "gyro.csv"), "--camera", str(folder / "camera.toml")),
        *("--capture", str(folder / "my frames.csv"), "--index", "4"),
        *("--mode", "row wise;", "echo", "$HOME", "`id`", "-o", str(output)),
    ]
    assert output.exists()
    assert not rendered.exists()
