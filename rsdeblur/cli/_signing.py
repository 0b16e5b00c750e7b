"""Options of commands that sign their results."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rsdeblur.cli._options import gathered
from rsdeblur.cli._types import PATH

if TYPE_CHECKING:
    from rsdeblur.io.claims import Credentials


@dataclass(frozen=True, slots=True)
class Signing:
    """Files of a signer's certificates and private key, and the address of a timestamp server."""

    sign: Path | None = None
    sign_key: Path | None = None
    sign_time: str | None = None

    def credentials(self) -> Credentials | None:
        """Read the signer of the results, or return None if they are not signed.

        Raises
        ------
        click.UsageError
            If only some of the options are given.
        RsdeblurError
            If the files are refused, or the extra is not installed.
        """
        if self == Signing():
            return None
        if self.sign is None or self.sign_key is None:
            missing = "--sign" if self.sign is None else "--sign-key"
            raise click.UsageError(f"{missing} missing: signing needs certificates, --sign, and their key, --sign-key")
        from rsdeblur.io.claims import read_credentials

        return read_credentials(self.sign, self.sign_key, timestamps=self.sign_time)


signing_options = gathered(
    "signing",
    Signing,
    (
        click.option(
            "--sign",
            type=PATH,
            metavar="PEM",
            help="Sign the result: a C2PA manifest names the photo and the parameters. Certificates of the signer.",
        ),
        click.option("--sign-key", type=PATH, metavar="PEM", help="Private key for --sign."),
        click.option("--sign-time", metavar="URL", help="Timestamp server for --sign.  [default: none]"),
    ),
)
