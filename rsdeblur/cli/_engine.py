"""Parts of the package that commands use, each imported at its first use, so that `rsdeblur --help` answers at once.

The stub beside this module lists them with the modules that have them.
"""

import ast
from functools import cache
from importlib import import_module
from importlib.resources import files
from typing import Any


@cache
def _modules() -> dict[str, str]:
    """Return the name of the module of each part."""
    stub = ast.parse(files(__package__).joinpath("_engine.pyi").read_text("utf-8"))
    imports = (node for node in stub.body if isinstance(node, ast.ImportFrom))
    return {part.name: str(node.module) for node in imports for part in node.names}


def __getattr__(name: str) -> Any:
    if name not in _modules():
        raise AttributeError(name)
    # Looked up again each time, so that tests can replace a part where it is defined.
    return getattr(import_module(_modules()[name]), name)
