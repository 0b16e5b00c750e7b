"""The installation: lazy names, modules that an import loads, allowed imports, show_config, the bare source folder."""

import ast
import os
import re
import subprocess
import sys
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import rsdeblur
from rsdeblur import config

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = Path(rsdeblur.__file__).parent

LADDER = re.findall(r"^    (\w+) +\S", rsdeblur.__doc__, flags=re.MULTILINE)
MODULES = sorted(set(PACKAGE.rglob("*.py")) - {PACKAGE / "__init__.py", PACKAGE / "_config.py"})


def python(code, *options, cwd, **environment):
    """Run `code` in a fresh interpreter and return the finished process."""
    command = [sys.executable, *options, "-c", code]
    return subprocess.run(command, cwd=cwd, env=os.environ | environment, capture_output=True, text=True, check=False)


@cache
def parsed(path):
    return ast.parse(path.read_text(encoding="utf-8"))


def rung(path):
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


def loaded_modules(path, *, in_functions=False):
    """Yield the dotted names, without `rsdeblur.`, of the modules that a file imports when it is loaded.

    Imports for type checking only do not count, those in functions only if `in_functions`.
    """
    pending = list(parsed(path).body)
    while pending:
        node = pending.pop()
        if isinstance(node, ast.Import):
            yield from (alias.name.removeprefix("rsdeblur.") for alias in node.names if "rsdeblur." in alias.name)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            if node.module == "rsdeblur":
                yield from (alias.name for alias in node.names)
            elif node.module.startswith("rsdeblur."):
                module = node.module.removeprefix("rsdeblur.")
                folder = (PACKAGE / module.replace(".", "/")).is_dir()
                submodules = {f"{module}.{alias.name}" for alias in node.names} if folder else set()
                found = {name for name in submodules if (PACKAGE / f"{name.replace('.', '/')}.py").is_file()}
                yield from found or {module}
        elif isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            pending += node.orelse
        elif in_functions or not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            pending += ast.iter_child_nodes(node)


def imported_names(path):
    """Yield the dotted names, without `rsdeblur.`, of everything that a file imports anywhere."""
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("rsdeblur"):
            module = node.module.removeprefix("rsdeblur").lstrip(".")
            yield from (f"{module}.{alias.name}".lstrip(".") for alias in node.names)


def test_every_module_has_a_rung():
    assert LADDER[:3] == ["errors", "types", "choices"]
    assert {rung(path) for path in MODULES} == set(LADDER)
    # A room that fills up is divided: bursts, calibration and tuning have their own.
    assert len(LADDER) <= 23


def test_imports_only_from_above():
    for path in MODULES:
        here = LADDER.index(rung(path))
        # Every module may import the products of the build.
        for name in {name.split(".")[0] for name in loaded_modules(path)} - {"_config", "_cext"}:
            assert name in LADDER, f"{path} imports {name} from the package: name its module instead"
            allowed = LADDER.index(name) < here or name == rung(path)
            assert allowed, f"{path} imports {name}, which is not above {rung(path)}"


def crossings(path, imported):
    """Return the forbidden imports between `motion` and `deconv`; the latter may import `BlurPaths`."""
    other = {"motion": ("deconv.", "psf."), "deconv": ("motion.", "io.", "image.", "tuning.", "estimate.", "pipeline.")}
    forbidden = other.get(rung(path), ())
    return {name for name in imported if name.startswith(forbidden)} - {"motion.paths.BlurPaths"}


def test_only_paths_and_psfs_cross_between_motion_and_deconvolution():
    found = {str(path): crossings(path, imported_names(path)) for path in MODULES}
    assert not {path: names for path, names in found.items() if names}


def test_a_violation_of_the_branch_rule_is_found():
    solver = PACKAGE / "deconv" / "wiener.py"
    assert crossings(solver, {"motion.gyro.GyroLog"}) == {"motion.gyro.GyroLog"}
    assert crossings(solver, {"motion.paths.Capture"}) == {"motion.paths.Capture"}
    assert crossings(PACKAGE / "motion" / "paths.py", {"deconv.fft.empty"}) == {"deconv.fft.empty"}
    assert not crossings(solver, {"motion.paths.BlurPaths", "psf.PsfBank"})


def test_modules_import_each_other_without_a_cycle():
    """Imports in functions count too."""
    graph = {}
    for path in MODULES:
        name = ".".join(path.relative_to(PACKAGE).with_suffix("").parts).removesuffix(".__init__")
        targets = loaded_modules(path, in_functions=True)
        graph[name] = {target for target in targets if target != name}
    known = set(graph)
    TopologicalSorter({name: targets & known for name, targets in graph.items()}).prepare()  # raises CycleError


def test_only_fft_imports_pyfftw():
    importers = {path.name for path in MODULES if re.search(r"^(import|from) pyfftw", path.read_text(), re.MULTILINE)}
    assert importers <= {"fft.py"}


def test_import_is_light(tmp_path):
    code = "import rsdeblur, sys; print([m for m in ('numba', 'scipy', 'pyfftw', 'skimage') if m in sys.modules])"
    process = python(code, cwd=tmp_path)
    assert (process.stdout.strip(), process.stderr) == ("[]", "")


def test_public_names_resolve():
    names = ("motion", "deconv", "tuning", "estimate", "calibration", "pipeline", "simulation")
    packages = [getattr(rsdeblur, name) for name in names]
    for package in (rsdeblur, *packages):
        for name in package.__all__:
            assert getattr(package, name) is not None
    assert set(rsdeblur.__all__) > {"deblur", "simulate", "GyroLog", "Camera", "RsdeblurError", "__version__"}
    assert len(rsdeblur.__all__) <= 40
    # No module or folder hides a public name, and every name has one place.
    assert not set(LADDER) & set(rsdeblur.__all__)
    assert {"motion", "io", "plot"} <= set(dir(rsdeblur)) - set(rsdeblur.__all__)
    assert not any(set(rsdeblur.__all__) & set(package.__all__) for package in packages)


def test_show_config_prints_the_facts(capsys):
    facts = config.facts()
    assert facts["rsdeblur"] == rsdeblur.__version__
    # What a dependency's wheel brings is said where a user asks what is installed.
    assert "GPL" in facts["licence"]
    assert "FFTW (pyfftw)" in facts["licence"]
    rsdeblur.show_config()
    printed = capsys.readouterr().out
    assert all(value in printed for value in facts.values())


def test_the_environment_turns_the_extension_off(tmp_path):
    code = """
from rsdeblur import config
from rsdeblur.kernels import spectral
assert spectral.multiply is spectral.multiply_numpy and spectral.blend is spectral.blend_numpy
print(config.facts()["cext"])
"""
    process = python(code, cwd=tmp_path, RSDEBLUR_PURE="1")
    assert process.stdout.startswith("not in use (the environment variable RSDEBLUR_PURE is set)"), process.stderr


def test_the_build_knows_every_subpackage():
    listed = re.search(r"^foreach package : (.*)$", (ROOT / "meson.build").read_text(), flags=re.MULTILINE)
    assert ast.literal_eval(listed[1]) == sorted(path.parent.name for path in ROOT.glob("rsdeblur/*/__init__.py"))


def test_the_bare_source_folder_says_what_to_do():
    # -S leaves out site-packages, and with it any installed rsdeblur.
    process = python("import rsdeblur", "-S", cwd=ROOT, PYTHONSAFEPATH="")
    assert process.returncode == 1
    assert "ImportError: rsdeblur was imported from its source folder" in process.stderr
    assert "pip install" in process.stderr
