"""Folders of loggers: which of their files belong to the recording."""

from __future__ import annotations

from pathlib import Path

from rsdeblur.io.sessions import camera_in, files_in


def test_results_are_not_taken_for_photos(tmp_path: Path) -> None:
    """A batch may write into its session; a later one into another folder must not deblur the results again."""
    for name in ("a.png", "frames/b.png", "old/c.png", "old/batch.json", "new/d.png"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    photos = [tmp_path / "a.png", tmp_path / "frames" / "b.png"]
    assert files_in(tmp_path, without=tmp_path / "new") == photos
    for output in (tmp_path, tmp_path.parent):
        assert files_in(tmp_path, without=output) == [*photos, tmp_path / "new" / "d.png"]


def test_one_camera_file_is_that_of_the_photos() -> None:
    assert camera_in([Path("a.png"), Path("b.TOML")]) == Path("b.TOML")
    assert camera_in([Path("a.toml"), Path("b.toml")]) is None
