"""C2PA manifests of results: what they state, that they bind the file, and what is refused."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rsdeblur.errors import FileFormatError, InputError, OutputError, RsdeblurWarning
from rsdeblur.io import read_picture, untrusted, write_picture
from rsdeblur.io._metadata import C2PA
from rsdeblur.io.claims import Credentials, read_credentials, with_claim
from rsdeblur.io.history import with_history
from rsdeblur.io.picture_output import picture_to_fill
from rsdeblur.io.pictures import Picture
from tests.installed import needs

c2pa = needs("c2pa")
from cryptography.hazmat.primitives import serialization  # noqa: E402
from cryptography.hazmat.primitives.asymmetric import ec, ed25519, rsa  # noqa: E402

PemFiles = Callable[..., tuple[Path, Path]]
PEM, PLAIN = serialization.Encoding.PEM, serialization.NoEncryption()
PARAMETERS = {"options": {"nsr": None, "sizes": [1, 2.5]}, "photo": {"name": "photo.png"}}
TYPES = {".jpg": "image/jpeg", ".png": "image/png", ".tif": "image/tiff", ".webp": "image/webp"}
PIXELS = np.random.default_rng(0).integers(0, 255, (48, 64, 3)).astype(np.uint8)


@pytest.fixture
def credentials(pem_files: PemFiles) -> Credentials:
    return read_credentials(*pem_files())


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    path = tmp_path / "photo.png"
    write_picture(path, PIXELS)
    return path


def manifests(path: Path) -> tuple[dict[str, Any], dict[str, Any], set[str]]:
    """Return the manifest store of a file, its active manifest, and the codes of its validation."""
    reader = c2pa.Reader(TYPES[path.suffix], BytesIO(path.read_bytes()))
    results = reader.get_validation_results()["activeManifest"]
    codes = {each["code"] for kind in ("success", "failure") for each in results[kind]}
    return json.loads(reader.json()), reader.get_active_manifest(), codes


@pytest.mark.parametrize("suffix", list(TYPES))
def test_a_result_names_its_photo_and_what_was_done(
    tmp_path: Path, photo: Path, credentials: Credentials, suffix: str
) -> None:
    like = with_claim(with_history(read_picture(photo), PARAMETERS), credentials, photo, PARAMETERS)
    out = tmp_path / f"sharp{suffix}"
    write_picture(out, PIXELS, like=like)
    _, active, codes = manifests(out)
    assert codes >= {"assertion.dataHash.match", "claimSignature.validated", "assertion.hashedURI.match"}
    # Nobody knows the issuer; nothing else is wrong.
    assert {code for code in codes if code not in SUCCESSES} == {"signingCredential.untrusted"}
    assert active["claim_generator_info"][0]["name"] == "rsdeblur"
    (original,) = active["ingredients"]
    assert (original["relationship"], original["title"]) == ("parentOf", "photo.png")
    opened, filtered = active["assertions"][0]["data"]["actions"]
    assert opened["parameters"]["ingredients"][0]["url"].endswith(original["label"])
    assert (opened["action"], filtered["action"]) == ("c2pa.opened", "c2pa.filtered")
    assert filtered["softwareAgent"]["name"] == "rsdeblur"
    assert json.loads(filtered["parameters"]["rsdeblur.parameters"]) == PARAMETERS
    # Pixels and other metadata are as without a signature.
    plain = tmp_path / f"plain{suffix}"
    write_picture(plain, PIXELS, like=replace(like, claim=None))
    signed, unsigned = read_picture(out), read_picture(plain)
    assert np.array_equal(signed.pixels, unsigned.pixels)
    assert (signed.xmp, signed.exif, signed.icc_profile) == (unsigned.xmp, unsigned.exif, unsigned.icc_profile)
    assert signed.xmp is not None
    assert (signed.losses, unsigned.losses) == ((C2PA,), ())


SUCCESSES = {
    "assertion.dataHash.match",
    "assertion.hashedURI.match",
    "claimSignature.validated",
    "claimSignature.insideValidity",
}


def test_the_manifest_of_the_photo_is_kept(tmp_path: Path, photo: Path, credentials: Credentials) -> None:
    first, second = tmp_path / "first.webp", tmp_path / "second.jpg"
    write_picture(first, PIXELS, like=with_claim(read_picture(photo), credentials, photo, {}))
    signed = read_picture(first)
    assert signed.losses == (C2PA,)
    like = with_claim(signed, credentials, first, {})
    # No warning that it is left out.
    write_picture(second, PIXELS, like=like)
    store, active, _ = manifests(second)
    assert len(store["manifests"]) == 2
    assert active["ingredients"][0]["active_manifest"] in store["manifests"]


def test_a_changed_pixel_breaks_the_claim(tmp_path: Path, photo: Path, credentials: Credentials) -> None:
    out = tmp_path / "sharp.tif"
    with picture_to_fill(
        out, PIXELS.shape, like=with_claim(read_picture(photo), credentials, photo, {}), in_place=True
    ) as pixels:
        pixels[:] = PIXELS
    assert "assertion.dataHash.match" in manifests(out)[2]
    data = out.read_bytes()
    out.write_bytes(data.replace(PIXELS.tobytes(), (PIXELS ^ 1).tobytes()))
    assert out.read_bytes() != data
    assert "assertion.dataHash.mismatch" in manifests(out)[2]


def test_a_failure_leaves_no_file(tmp_path: Path, photo: Path, credentials: Credentials) -> None:
    like = with_claim(read_picture(photo), credentials, photo, {})
    photo.unlink()
    before = sorted(tmp_path.iterdir())
    with pytest.raises(FileFormatError, match=r"photo\.png: cannot read the photo"):
        write_picture(tmp_path / "sharp.png", PIXELS, like=like)
    with pytest.raises(OutputError, match=r"NumPy files cannot be signed; use one of JPEG, PNG, TIFF, WebP"):
        write_picture(tmp_path / "sharp.npy", PIXELS, like=like)
    assert sorted(tmp_path.iterdir()) == before


def test_files_of_unknown_formats_are_named(tmp_path: Path, credentials: Credentials) -> None:
    photo, out = tmp_path / "photo.npy", tmp_path / "sharp.png"
    write_picture(photo, PIXELS)
    write_picture(out, PIXELS, like=with_claim(read_picture(photo), credentials, photo, {}))
    assert manifests(out)[1]["ingredients"][0]["title"] == "photo.npy"


def test_manifests_are_not_read_where_that_is_forbidden(
    tmp_path: Path, photo: Path, credentials: Credentials, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = tmp_path / "first.png", tmp_path / "second.png"
    write_picture(first, PIXELS, like=with_claim(read_picture(photo), credentials, photo, {}))
    monkeypatch.setenv(untrusted.VARIABLE, "1")
    like = with_claim(read_picture(first), credentials, first, {})
    with pytest.warns(RsdeblurWarning, match="C2PA"):
        write_picture(second, PIXELS, like=like)
    assert len(manifests(second)[0]["manifests"]) == 1


@pytest.mark.parametrize(
    ("key", "algorithm"),
    [
        (ec.generate_private_key(ec.SECP384R1()), "es384"),
        (ed25519.Ed25519PrivateKey.generate(), "ed25519"),
        (rsa.generate_private_key(65537, 2048), "ps256"),
    ],
)
def test_keys_of_every_kind(pem_files: PemFiles, photo: Path, key: Any, algorithm: str) -> None:
    signer = read_credentials(*pem_files(key))
    assert signer.algorithm == algorithm
    with_claim(Picture(PIXELS), signer, photo, {})


def test_wrong_files_are_refused(pem_files: PemFiles, photo: Path) -> None:
    chain, key = pem_files(form=serialization.PrivateFormat.TraditionalOpenSSL)
    signer = read_credentials(chain, key)
    for secret in ("PRIVATE", "es256", str(signer.key)[:40]):
        assert (secret in repr(signer)) == (secret == "es256")
    with pytest.raises(FileFormatError, match=r"photo\.png: no certificates in PEM"):
        read_credentials(photo, key)
    with pytest.raises(FileFormatError, match=r"chain\.pem: no private key in PEM"):
        read_credentials(chain, chain)
    other = ec.generate_private_key(ec.SECP256R1())
    for private, encryption, message in (
        (other, PLAIN, r"not the key of the first certificate"),
        (other, serialization.BestAvailableEncryption(b"a"), r"the key is encrypted; decrypt it with"),
    ):
        key.write_bytes(private.private_bytes(PEM, serialization.PrivateFormat.PKCS8, encryption))
        with pytest.raises(FileFormatError, match=message):
            read_credentials(chain, key)
    curve = ec.generate_private_key(ec.SECP256K1())
    with pytest.raises(FileFormatError, match=r"C2PA needs a key of P-256, P-384, P-521, RSA or Ed25519"):
        read_credentials(*pem_files(curve))


def test_what_c2pa_refuses_is_refused_before_the_work(
    tmp_path: Path, pem_files: PemFiles, photo: Path, credentials: Credentials
) -> None:
    with pytest.raises(FileFormatError, match=r"chain\.pem: cannot sign with these certificates: .*self-signed"):
        with_claim(Picture(PIXELS), read_credentials(*pem_files(is_authority=True)), photo, {})
    out = tmp_path / "signed.png"
    write_picture(out, PIXELS, like=with_claim(Picture(PIXELS), credentials, photo, {}))
    out.write_bytes(out.read_bytes().replace(b"c2pa.hash.data", b"c2pa.hash.dada"))
    with pytest.raises(FileFormatError, match=r"signed\.png: the C2PA manifest in it is damaged"):
        with_claim(Picture(PIXELS), credentials, out, {})


def test_without_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "c2pa", None)
    with pytest.raises(InputError, match=r"signing needs c2pa-python.*'\.\[c2pa\]'"):
        read_credentials(tmp_path / "chain.pem", tmp_path / "key.pem")
