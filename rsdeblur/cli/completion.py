"""`rsdeblur completion`: scripts that complete commands, options and file names in a shell."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class

from rsdeblur.cli._output import say

EXAMPLES = """\b
Examples:
  rsdeblur completion bash > ~/.local/share/bash-completion/completions/rsdeblur
  rsdeblur completion zsh > ~/.zfunc/_rsdeblur
  rsdeblur completion fish > ~/.config/fish/completions/rsdeblur.fish
"""


@click.command("completion", epilog=EXAMPLES)
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def command(shell: str) -> None:
    """Print the script for completion in SHELL.

    It completes commands, options, choices and file names.
    """
    from rsdeblur.cli import main

    kind = get_completion_class(shell)
    assert kind is not None  # click has all three
    say(*kind(main, {}, "rsdeblur", "_RSDEBLUR_COMPLETE").source().splitlines())
