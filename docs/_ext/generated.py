"""Pages made when the site is built: every command from its own help, every public name from its docstring.

They are written to `generated/`, which is not committed, so no page can fall behind the code.
"""

from __future__ import annotations

import inspect
import re
import tomllib
from collections.abc import Iterable, Iterator
from importlib import import_module
from importlib.resources import files
from pathlib import Path
from typing import Any

import click
from docutils import nodes
from docutils.nodes import Element
from PIL import Image
from pygments.lexers.shell import BashLexer
from pygments.token import Name
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util.nodes import make_refnode

import rsdeblur
from rsdeblur.cli import main
from rsdeblur.cli._output import SCHEMA

# Modules for users, beside the names of `rsdeblur` itself, in the order of the package's ladder.
MODULES = (
    "errors", "motion", "motion.axes", "deconv", "deconv.priors", "tuning", "estimate",
    "calibration", "simulation", "pipeline", "io", "report", "plot",
    "video.clip", "video.plan", "video.encode",
)  # fmt: skip


# The stable keys of each kind of record, with their meanings.
RECORDS = tomllib.loads(files("rsdeblur.cli").joinpath("schema.toml").read_text("utf-8"))
JSON = """Each command with ``--json`` prints one value, which has ``schema``: {schema}. That number rises when a key of
this list is removed or changes its meaning. Other keys may change. A key with ``?`` may be missing. ``[]`` is an item
of a list, ``*`` a name of a map. The files ``batch.json``, ``compare.json`` and ``triage.json`` are as their commands
print.
"""


def heading(text: str, line: str) -> str:
    """Return a reST heading."""
    return f"{text}\n{line * len(text)}\n"


def commands(command: click.Command, name: str, parent: click.Context | None = None) -> Iterator[click.Context]:
    """Yield the context of a command and of those below it."""
    context = click.Context(command, info_name=name, parent=parent, **command.context_settings)
    yield context
    if isinstance(command, click.Group):
        for child in command.list_commands(context):
            below = command.get_command(context, child)
            if below is not None:
                yield from commands(below, child, context)


def literal(text: str) -> str:
    """Return text unchanged."""
    return ".. code-block:: text\n\n" + "".join(f"   {line}".rstrip() + "\n" for line in text.splitlines())


def command_section(context: click.Context, title: str | None = None, line: str = "-") -> str:
    """Return what a command's `--help-all` prints, as a section; commands of a group link to pages beside this one."""
    command = context.command
    said = inspect.cleandoc(command.help or "").replace("\b\n", "")
    parts = [heading(title or context.command_path, line), literal(command.get_usage(context).removeprefix("Usage: "))]
    parts.append(re.sub(r"([*|`\\])", r"\\\1", said) + "\n")
    for parameter in command.get_params(context):
        record = parameter.get_help_record(context)
        if record is not None and record[1]:
            text = re.sub(r"([*|`\\])", r"\\\1", record[1])
            parts.append(f"``{record[0]}``\n   {text}\n")
    if isinstance(command, click.Group):
        for child in command.list_commands(context):
            below = command.get_command(context, child)
            assert below is not None
            term = f":doc:`{child}`" if command is main else f"``{child}``"
            parts.append(f"{term}\n   {below.get_short_help_str(200)}\n")
    examples = inspect.cleandoc(command.epilog or "").replace("\b", "").strip()
    return "\n".join([*parts, literal(examples)] if examples else parts)


def described(kind: str, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yield the path of each stable key of a kind, like ``modes.*.check.verdict``, and its meaning."""
    for name, key in RECORDS[kind].items():
        if isinstance(key, str):
            yield prefix + name, key
        else:
            ((form, inner),) = key.items()
            yield from described(inner, prefix + name + {"list": "[].", "map": ".*.", "record": "."}[form])


def json_page() -> str:
    """Return the page that lists the stable keys of what commands print as JSON."""
    inner = {
        kind for keys in RECORDS.values() for key in keys.values() if isinstance(key, dict) for kind in key.values()
    }
    parts = [heading("JSON schema", "="), JSON.format(schema=SCHEMA)]
    for kind in RECORDS:
        if kind not in inner:
            parts.append(heading(kind, "-"))
            parts += [f"``{name}``\n   {text}\n" for name, text in described(kind)]
    return "\n".join(parts)


def command_pages() -> dict[str, str]:
    """Return a page for each command, with its subcommands, and the page that lists them."""
    context = click.Context(main, info_name="rsdeblur", **main.context_settings)
    names = main.list_commands(context)
    toctree = ".. toctree::\n   :hidden:\n\n" + "".join(f"   {name}\n" for name in (*names, "json"))
    index = "\n".join([command_section(context, "Commands", "="), toctree])
    pages = {"commands/json": json_page(), "commands/index": index}
    for name in names:
        command = main.get_command(context, name)
        assert command is not None
        first, *below = commands(command, name, context)
        pages[f"commands/{name}"] = "\n".join([command_section(first, name, "="), *map(command_section, below)])
    return pages


def ladder() -> dict[str, str]:
    """Return what the package's docstring says of each module, in its order."""
    return dict(re.findall(r"^    (\w+) +(\S.*)$", rsdeblur.__doc__ or "", re.MULTILINE))


def table(names: Iterable[str]) -> str:
    """Return a table of names, each with the first line of its docstring."""
    return ".. autosummary::\n   :nosignatures:\n\n" + "".join(f"   {name}\n" for name in names)


def entry(module: str, name: str) -> str:
    """Return the directive that shows the docstring of a name."""
    thing = getattr(import_module(module), name)
    if not inspect.isclass(thing):
        return f".. autofunction:: {name}\n"
    if issubclass(thing, BaseException):
        return f".. autoexception:: {name}\n"
    # Methods of an own base class, such as those that all logs have, belong to each class's page.
    own = any(base.__module__.startswith("rsdeblur.") for base in thing.__mro__[1:])
    return f".. autoclass:: {name}\n   :members:\n" + "   :inherited-members: object\n" * own


def public(module: Any) -> list[str]:
    """Return the functions and classes of a module that neither `rsdeblur` nor its package has, in the text's order."""
    own = [name for name, thing in vars(module).items() if getattr(thing, "__module__", None) == module.__name__]
    names = getattr(module, "__all__", [name for name in own if name[0] != "_" and callable(getattr(module, name))])
    above = {*rsdeblur.__all__, *getattr(import_module(module.__name__.rpartition(".")[0]), "__all__", ())}
    return [name for name in names if name not in above]


def place(name: str) -> str:
    """Return the page of a name; classes and functions have folders, as some differ by the case of letters only."""
    return f"{'classes' if inspect.isclass(getattr(rsdeblur, name)) else 'functions'}/{name}"


def package_pages() -> dict[str, str]:
    """Return a page for each name of `rsdeblur`, and the page that lists them in the order of the ladder."""
    names: dict[str, list[str]] = {}
    for name in rsdeblur.__all__:
        if name != "__version__":
            home = getattr(rsdeblur, name).__module__.split(".")[1]
            names.setdefault(home, []).append(name)
    here = ".. currentmodule:: rsdeblur\n"
    parts = [heading("rsdeblur", "="), "In the order in which data flow; each name has a page.\n", here]
    pages = {}
    for module, said in ladder().items():
        if module in names:
            toctree = ".. toctree::\n   :hidden:\n\n" + "".join(f"   {place(name)}\n" for name in names[module])
            parts += [heading(said[0].upper() + said[1:], "-"), table(names[module]), toctree]
            for name in names[module]:
                pages[f"names/{place(name)}"] = "\n".join([heading(name, "="), here, entry("rsdeblur", name)])
    return pages | {"names/rsdeblur": "\n".join(parts)}


def module_page(name: str) -> str:
    """Return the page of one module."""
    module = import_module(f"rsdeblur.{name}")
    title = heading(module.__name__, "=")
    names = public(module)
    described = [entry(module.__name__, each) for each in names]
    return "\n".join((title, f".. automodule:: {module.__name__}\n", table(names), *described))


def equations(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Make indented paragraphs before a docstring's first section literal: in this package they are equations."""
    end = next((i for i, line in enumerate(lines) if line.startswith("---")), len(lines))
    for i in range(end - 1, 1, -1):
        if lines[i].startswith("    ") and not lines[i - 1] and not lines[i - 2].startswith(" "):
            lines[i:i] = ["::", ""]


def link(app: Sphinx, env: BuildEnvironment, node: pending_xref, shown: Element) -> Element | None:
    """Link a short name in a docstring to the one public name that ends so; leave inner names as they stand."""
    if node.get("refdomain") != "py":
        return None
    ending = "." + node["reftarget"].rpartition(".")[2]
    found = [entry for entry in env.get_domain("py").get_objects() if entry[0].endswith(ending)]
    if not found:
        return shown
    name, _, _, page, anchor, _ = min(found, key=lambda entry: len(entry[0]))
    return make_refnode(app.builder, node["refdoc"], page, anchor, shown, name)


def write_pages(app: Sphinx) -> None:
    """Write the pages that are not as they were, so that an unchanged one is not built again."""
    folder = Path(app.srcdir) / "generated"
    pages = command_pages() | package_pages() | {f"names/{name}": module_page(name) for name in MODULES}
    for name, text in pages.items():
        path = folder / f"{name}.rst"
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def leave_out_of_search(app: Sphinx, doctree: Element) -> None:
    """Keep pages for developers out of the site's search, where they would precede tutorials."""
    if app.env.docname.startswith("developer/"):
        app.env.metadata[app.env.docname]["nosearch"] = True


def link_gallery(app: Sphinx, page: str, source: list[str]) -> None:
    """Link to the built gallery where pages link to its source, which a code host shows."""
    source[0] = source[0].replace("(gallery/README.rst)", "(generated/gallery/index.rst)")


def add_captions(app: Sphinx, doctree: Element) -> None:
    """Show the description of each figure below it, unless a caption in italics follows."""
    for image in list(doctree.findall(nodes.image)):
        below = image.parent.next_node(descend=False, siblings=True)
        is_alone = isinstance(image.parent, nodes.paragraph) and len(image.parent) == 1
        if is_alone and image.get("alt") and not (below and isinstance(below[0], nodes.emphasis)):
            caption = nodes.paragraph("", "", nodes.emphasis("", " ".join(image["alt"].split())))
            image.parent.parent.insert(image.parent.parent.index(image.parent) + 1, caption)


def crop_thumbnails(app: Sphinx) -> None:
    """Replace the gallery's thumbnails of pictures side by side by the square in their middle, without their titles."""
    for path in Path(app.srcdir).glob("generated/gallery/images/sphx_glr_*_001.png"):
        with Image.open(path) as strip:
            width, height = strip.size
            side = round(0.85 * height)
            if width > 2 * height:
                square = strip.crop(((width - side) // 2, height - side, (width + side) // 2, height))
                square.resize((280, 280)).save(path.parent / "thumb" / f"{path.stem[:-4]}_thumb.png")


class ShellLexer(BashLexer):
    """Shell commands whose options are one token each, so that narrow screens break lines before them."""

    tokens = BashLexer.tokens | {"data": [(r"(?<=\s)--?[a-z][\w-]*", Name.Attribute), *BashLexer.tokens["data"]]}


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("doctree-read", leave_out_of_search)
    app.connect("doctree-read", add_captions)
    app.connect("source-read", link_gallery)
    app.connect("builder-inited", write_pages)
    app.connect("builder-inited", crop_thumbnails, priority=900)  # after the gallery has run
    app.add_lexer("sh", ShellLexer)
    app.connect("autodoc-process-docstring", equations, priority=400)  # before numpydoc takes the sections apart
    app.connect("missing-reference", link)
    return {"parallel_read_safe": True}
