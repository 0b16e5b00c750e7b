"""A random sample of the project's prose, to be read by a person: ``python -m benchmarks.prose --seed 1``.

Draws docstrings and comments of the package and sentences of the user pages, with their places. The developer pages'
rule: at most 3 of 180 may need a second reading.
"""

from __future__ import annotations

import argparse
import ast
import io
import random
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# User pages; the developer's and the benchmarks' pages and generated ones are not among them.
PAGES = ("README.md", "docs/*.md", "docs/theory/*.md", "docs/tutorials/*.md")


def docstrings() -> Iterator[tuple[str, str]]:
    """Yield the place and the text of every docstring of the package."""
    for path in sorted((ROOT / "rsdeblur").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                text = ast.get_docstring(node)
                if text:
                    yield f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 1)}", text


def comments() -> Iterator[tuple[str, str]]:
    """Yield the place and the text of every comment of the package; lines that follow each other are one comment."""
    for path in sorted((ROOT / "rsdeblur").rglob("*.py")):
        last, text, first = -2, "", 0
        for token in tokenize.generate_tokens(io.StringIO(path.read_text(encoding="utf-8")).readline):
            if token.type != tokenize.COMMENT or re.match(r"#\s*(type|noqa|fmt):", token.string):
                continue
            row, words = token.start[0], token.string.lstrip("# ")
            if row == last + 1 and token.line.lstrip().startswith("#"):
                text += " " + words
            else:
                if text:
                    yield f"{path.relative_to(ROOT)}:{first}", text
                text, first = words, row
            last = row
        if text:
            yield f"{path.relative_to(ROOT)}:{first}", text


def sentences() -> Iterator[tuple[str, str]]:
    """Yield the page and the text of every sentence of the user pages, code and tables left out."""
    for pattern in PAGES:
        for path in sorted(ROOT.glob(pattern)):
            text = re.sub(r"```.*?```", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
            lines = [line for line in text.splitlines() if not re.match(r"\s*(\||#|!\[|\*!)", line)]
            for block in re.split(r"\n\s*\n|\n\s*(?=[-*] |\d+\. )", "\n".join(lines)):
                for sentence in re.split(r"(?<=[.!?:])\s+(?=[A-Z`\[*])", " ".join(block.split())):
                    if len(sentence.split()) > 3:
                        yield str(path.relative_to(ROOT)), sentence


def main() -> None:
    """Print the sample."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1, help="of the random sample (1)")
    parser.add_argument("--count", type=int, default=60, help="of each kind (60)")
    options = parser.parse_args()
    draw = random.Random(options.seed)
    for kind in (docstrings, comments, sentences):
        everything = list(kind())
        print(f"\n=== {options.count} of {len(everything)} {kind.__name__}")
        for place, text in draw.sample(everything, options.count):
            print(f"\n{place}\n{text}")


if __name__ == "__main__":
    main()
