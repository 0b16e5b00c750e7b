"""C2PA manifests of results: from which photo a picture was made, by what, with which parameters, and who says so.

A claim is what a manifest states and its signer signs. The photo is the claim's ingredient with the relationship
`parentOf`; if it has a manifest itself, the new one contains that, too. Nothing is fetched from a network, unless a
timestamp server is given.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from PIL import Image

from rsdeblur._config import VERSION
from rsdeblur._util import validate
from rsdeblur._util.atomic import temporary_beside
from rsdeblur._util.extras import missing
from rsdeblur._util.files import checked_path, open_file, read_file
from rsdeblur.errors import FileFormatError, InputError, OutputError
from rsdeblur.io import _exif_renewal, _heif, untrusted
from rsdeblur.io._metadata import C2PA

if TYPE_CHECKING:
    from collections.abc import Mapping

    from cryptography.hazmat.primitives.asymmetric.types import PrivateKeyTypes

    from rsdeblur.io.pictures import Picture

__all__ = ["Claim", "Credentials", "read_credentials", "with_claim"]

# Media types of the formats that can be signed, and of files by the bytes that they start with.
TYPES = {"JPEG": "image/jpeg", "PNG": "image/png", "TIFF": "image/tiff", "WebP": "image/webp"}
MAGIC = {b"\xff\xd8\xff": "image/jpeg", b"\x89PNG\r\n\x1a\n": "image/png"}
# Makers' raw files are TIFF inside, so only the suffix distinguishes these.
TIFF_SUFFIXES = {".tif": "image/tiff", ".tiff": "image/tiff", ".dng": "image/x-adobe-dng"}
# A file in which C2PA looks for no manifest.
UNKNOWN = "application/octet-stream"

AGENT = {"name": "rsdeblur", "version": VERSION}
# The name of the ingredient inside the claim.
ORIGINAL = "original"
# Signing would otherwise fetch manifests that are stored elsewhere, and lists of revoked certificates. A thumbnail of
# the blurred photo is not needed in the result.
SETTINGS = {
    "verify": {"remote_manifest_fetch": False, "ocsp_fetch": False},
    "builder": {"thumbnail": {"enabled": False}},
}
# Algorithms of C2PA (COSE) by elliptic curve.
CURVES = {"secp256r1": "es256", "secp384r1": "es384", "secp521r1": "es512"}


@dataclass(frozen=True, slots=True)
class Credentials:
    """Certificates and private key for signing claims; made by :func:`read_credentials`.

    Parameters
    ----------
    certificates : bytes
        The signer's certificate, followed by those of its issuers, in PEM.
    key : bytes
        The private key in PEM (PKCS 8), not encrypted.
    algorithm : {"es256", "es384", "es512", "ps256", "ed25519"}
        Algorithm of the signature.
    source : str
        Name of the certificates' file, for messages.
    timestamps : str, optional
        Address of a timestamp server (RFC 3161).
    """

    certificates: bytes = field(repr=False)
    key: bytes = field(repr=False)
    algorithm: str
    source: str
    timestamps: str | None = None


@dataclass(frozen=True, slots=True)
class Claim:
    """What the manifest of a result states; made by :func:`with_claim`.

    Parameters
    ----------
    credentials : Credentials
        The signer.
    original : Path
        The photo.
    parameters : str
        What the result depends on, as JSON.
    """

    credentials: Credentials
    original: Path
    parameters: str


def read_credentials(
    certificates: str | os.PathLike[str], key: str | os.PathLike[str], *, timestamps: str | None = None
) -> Credentials:
    """Read the certificates and the private key of a signer (extra ``[c2pa]``).

    Parameters
    ----------
    certificates : path-like
        PEM file: the signer's certificate, then those of its issuers. The first one must permit digital signatures,
        for e-mail protection or document signing, and be no authority itself.
    key : path-like
        PEM file of the private key, not encrypted: elliptic (P-256, P-384, P-521), RSA or Ed25519.
    timestamps : str, optional
        Address of a timestamp server (RFC 3161). Each signature then sends its digest there, so that it stays valid
        after the certificate has expired. By default nothing is sent.

    Returns
    -------
    Credentials
        The certificates and the key.

    Raises
    ------
    FileFormatError
        If a file cannot be read, is not PEM, or the key is encrypted, unsuitable, or not that of the certificate.
    InputError
        If the extra is not installed.
    """
    _library()
    from cryptography import x509
    from cryptography.hazmat.primitives import serialization

    if timestamps is not None:
        validate.instance("timestamps", timestamps, str)
    chain, secret = read_file(certificates, "certificates"), read_file(key, "key")
    try:
        first = x509.load_pem_x509_certificates(chain)[0]
    except ValueError as error:
        raise FileFormatError(f"{certificates}: no certificates in PEM, which start with -----BEGIN: {error}") from None
    try:
        private = serialization.load_pem_private_key(secret, password=None)
    except TypeError:
        raise FileFormatError(
            f"{key}: the key is encrypted; decrypt it with: openssl pkcs8 -in KEY -out PLAIN.pem"
        ) from None
    except ValueError as error:
        raise FileFormatError(f"{key}: no private key in PEM: {error}") from None
    if private.public_key() != first.public_key():
        raise FileFormatError(f"{key}: not the key of the first certificate in {certificates}")
    algorithm = _algorithm(private)
    if algorithm is None:
        raise FileFormatError(f"{key}: C2PA needs a key of P-256, P-384, P-521, RSA or Ed25519")
    plain = private.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    return Credentials(chain, plain, algorithm, str(certificates), timestamps)


def with_claim(
    picture: Picture, credentials: Credentials, original: str | os.PathLike[str], parameters: Mapping[str, Any]
) -> Picture:
    """Return a picture like which results are signed: its claim names the photo and what was done to it.

    Parameters
    ----------
    picture : Picture
        The picture that will be `like` in :func:`rsdeblur.write_picture`, which then signs.
    credentials : Credentials
        The signer.
    original : path-like
        The photo; it is read again when the result is written.
    parameters : mapping
        What the result depends on; it is written as JSON.

    Returns
    -------
    Picture
        The picture with the claim.

    Raises
    ------
    FileFormatError
        If C2PA refuses the certificates, or a manifest in the photo is damaged.
    InputError
        If the extra ``[c2pa]`` is not installed.
    """
    claim = Claim(credentials, checked_path(original), parameters_text(parameters))
    # Whatever would fail after the work fails here.
    trial = BytesIO()
    Image.new("L", (1, 1)).save(trial, "PNG")
    _sign(trial, BytesIO(), Path("trial.png"), "PNG", replace(claim, credentials=replace(credentials, timestamps=None)))
    is_known = _type_of(claim.original) != UNKNOWN
    losses = tuple(loss for loss in picture.losses if loss != C2PA or not is_known)
    return replace(picture, claim=claim, losses=losses)


def parameters_text(parameters: Mapping[str, Any]) -> str:
    """Return parameters as JSON of one line; values that JSON does not have become text."""
    return json.dumps(parameters, sort_keys=True, separators=(",", ":"), default=str)


def check_kind(path: Path, kind: str) -> None:
    """Raise `OutputError` if pictures of a kind cannot be signed."""
    if kind not in TYPES:
        raise OutputError(f"{path}: {kind} files cannot be signed; use one of {', '.join(TYPES)}")


@contextmanager
def signed(file: BinaryIO, path: Path, kind: str, claim: Claim | None) -> Iterator[BinaryIO]:
    """Yield a file to fill, which is signed into `file` at the end; without a claim this is `file` itself.

    Parameters
    ----------
    file : binary file
        The empty file of the result, open for reading and writing.
    path : Path
        The name of the result.
    kind : {"JPEG", "PNG", "TIFF", "WebP"}
        Format of the result.
    claim : Claim, optional
        The claim.

    Raises
    ------
    FileFormatError, InputError, OutputError
        See :func:`with_claim`; and if the disk is full.
    """
    if claim is None:
        yield file
        return
    # Beside the result, because it may be larger than the memory, or than the folder of temporary files.
    with temporary_beside(Path(os.path.realpath(path))) as unsigned:
        yield unsigned
        _sign(unsigned, file, path, kind, claim)


def _sign(unsigned: BinaryIO, out: BinaryIO, path: Path, kind: str, claim: Claim) -> None:
    library = _library()
    by = claim.credentials
    unsigned.seek(0)
    with library.Context(library.Settings.from_dict(SETTINGS)) as context:
        builder = library.Builder.from_json(json.dumps(_manifest(_title(path), claim)), context=context)
        ingredient = {"title": _title(claim.original), "relationship": "parentOf", "label": ORIGINAL}
        try:
            with open_file(claim.original, "photo") as photo:
                builder.add_ingredient(ingredient, _type_of(claim.original), photo)
        except library.C2paError as error:
            raise FileFormatError(
                f"{claim.original}: the C2PA manifest in it is damaged ({error}): do not sign, or remove it first"
            ) from error
        try:
            signer = library.Signer.from_info(
                library.C2paSignerInfo(by.algorithm, by.certificates, by.key, by.timestamps)
            )
            builder.sign(signer, TYPES[kind], unsigned, out)
        except library.C2paError.Io as error:
            raise OutputError(f"{path}: cannot write the file: {error}") from error
        except library.C2paError as error:
            server = f" or the timestamps of {by.timestamps}" if by.timestamps else ""
            raise FileFormatError(f"{by.source}: cannot sign with these certificates{server}: {error}") from error


def _manifest(title: str, claim: Claim) -> dict[str, Any]:
    """Return the definition of the manifest."""
    opened = {"action": "c2pa.opened", "parameters": {"ingredientIds": [ORIGINAL]}}
    filtered = {
        "action": "c2pa.filtered",
        "when": _exif_renewal.now().isoformat(timespec="seconds"),
        "softwareAgent": AGENT,
        "description": "Camera-shake blur removed",
        # As text: c2pa-rs 0.91 turns lists of numbers into bytes.
        "parameters": {"rsdeblur.parameters": claim.parameters},
    }
    actions = {"label": "c2pa.actions.v2", "data": {"actions": [opened, filtered]}}
    return {"claim_generator_info": [AGENT], "title": title, "assertions": [actions]}


def _title(path: Path) -> str:
    """Return the name of a file as text; bytes that are not UTF-8 are replaced."""
    return os.fsencode(path.name).decode(errors="replace")


def _type_of(path: Path) -> str:
    """Return the media type of a photo as C2PA knows it."""
    if untrusted.blocked():
        return UNKNOWN
    with open_file(path, "photo") as file:
        head = file.read(16)
    if (head[:4], head[8:12]) == (b"RIFF", b"WEBP"):
        return "image/webp"
    if _heif.is_heif(head):
        return "image/heic"
    by_content = (kind for magic, kind in MAGIC.items() if head.startswith(magic))
    return next(by_content, TIFF_SUFFIXES.get(path.suffix.lower(), UNKNOWN))


def _algorithm(key: PrivateKeyTypes) -> str | None:
    from cryptography.hazmat.primitives.asymmetric import ec, ed25519, rsa

    if isinstance(key, ec.EllipticCurvePrivateKey):
        return CURVES.get(key.curve.name)
    if isinstance(key, rsa.RSAPrivateKey):
        return "ps256"
    return "ed25519" if isinstance(key, ed25519.Ed25519PrivateKey) else None


def _library() -> Any:
    try:
        import c2pa
    except ModuleNotFoundError:
        raise InputError(missing("signing needs c2pa-python", "c2pa")) from None
    return c2pa
