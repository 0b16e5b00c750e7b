"""Scripts for other programs: darktable's export target, run by Lua with a stand-in for darktable."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

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
