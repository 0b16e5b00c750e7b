"""Facts about results, which commands print as JSON and pages show, and the same in words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rsdeblur.estimate.refine import Refinement
from rsdeblur.pipeline.plan import DeblurResult
from rsdeblur.types import FloatImage

# Pixels along the picture's edges that do not count, because light from beyond the frame blurred them.
BORDER = 24


def result_facts(result: DeblurResult, output: Path, prior: str, seconds: float) -> dict[str, Any]:
    """Return the facts about a result that was written to `output` after some `seconds`."""
    return {
        "output": str(output),
        "mode": result.mode,
        "tile_error_px": result.tile_error,
        "psf_px": list(result.psfs.size[::-1]),
        "prior": prior,
        **{name: getattr(result, name) for name in ("bands", "strips", "nsr", "weight", "noise", "chroma", "timings")},
        "seconds": seconds,
        "check": None if result.check is None else asdict(result.check),
        "refinement": refinement_facts(result.refinement),
    }


def refinement_facts(refinement: Refinement | None) -> dict[str, Any] | None:
    """Return the facts about a correction of the recording."""
    if refinement is None:
        return None
    return {
        **{name: getattr(refinement, name) for name in ("accepted", "reason", "confidence", "gain", "fall")},
        "values": asdict(refinement.values),
        "sd": asdict(refinement.sd),
        "regions": None if refinement.regions is None else refinement.regions.tolist(),
    }


def summary(facts: Mapping[str, Any]) -> str:
    """Return `result_facts` in one line: how the result was made, and the verdict of the check."""
    wide, tall = facts["psf_px"]
    tiles = "rows" if facts["mode"] == "rowwise" else "bands"
    strength = f"NSR {facts['nsr']:.2g}" if facts["weight"] is None else f"weight {facts['weight']:.2g}"
    check = facts["check"]
    verdict = "" if check is None else f"; {check['verdict']}"
    blended = ", blended towards the photo" if check and check["blended"] else ""
    error = facts.get("tile_error_px")
    because = f" (tiles would err by {error:.2f} px)" if facts["mode"] == "rowwise" and error is not None else ""
    return (
        f"{facts['mode']}{because}, "
        f"{facts['bands']} x {facts['strips']} PSFs ({tiles} x strips) of {wide} x {tall} px, "
        f"{facts['prior']}, {strength}, {facts['seconds']:.2f} s{verdict}{blended}"
    )


def remarks(facts: Mapping[str, Any], *, asked: bool = True) -> list[str]:
    """Return lines about a result: reasons of the check, its moment, and the correction if there is one or `asked`."""
    check, refinement = facts.get("check"), facts.get("refinement")
    lines = [f"  {' '.join(check['reasons'])}"] if check and check["reasons"] else []
    if (offset := facts.get("time_offset_s")) is not None:
        lines.append(
            f"  The exposure began {abs(offset):.3f} s {'before' if offset > 0 else 'after'} the time in EXIF."
        )
    if refinement and (asked or refinement["accepted"]):
        lines.append(f"  {correction_text(refinement)}")
    return lines


def correction_text(facts: Mapping[str, Any]) -> str:
    """Return a sentence about a correction of the recording, of which `refinement_facts` are given."""
    if not facts["accepted"]:
        reason = facts["reason"]
        return f"Recording not corrected: {reason}{'' if reason.endswith('?') else '.'}"
    values = facts["values"]
    drift, acceleration = ((values[f"{name}_x"], values[f"{name}_y"]) for name in ("drift", "acceleration"))
    regions = facts["regions"]
    near = f" (x {min(map(min, regions)):g} to {max(map(max, regions)):g} by region)" if regions else ""
    texts = {
        f"focal length x {math.exp(values['scale']):.3f}": values["scale"],
        "drift {:+.1f} and {:+.1f} px".format(*drift) + near: any(drift),
        "acceleration {:+.0f} and {:+.0f} px/s²".format(*acceleration): any(acceleration),
        f"time offset {1e3 * values['offset']:+.1f} ms": values["offset"],
        f"readout time x {math.exp(values['readout']):.2f}": values["readout"],
        f"roll bias {values['roll']:+.3f} rad/s": values["roll"],
    }
    return f"Recording corrected: {', '.join(text for text, changed in texts.items() if changed)}."


def similarity(image: FloatImage, truth: FloatImage) -> dict[str, float | None]:
    """Return PSNR in dB and SSIM of display values in [0, 1], without borders and alpha.

    PSNR is None for equal pictures, because JSON has no infinity. SSIM uses the Gaussian window of its authors (Wang
    et al. 2004).
    """
    # Slow to load, and few commands need it.
    from skimage.metrics import peak_signal_noise_ratio, structural_similarity

    # Small pictures lose no more than a quarter of a side at each edge.
    y, x = (min(BORDER, side // 4) for side in image.shape[:2])
    a, b = (values[y : values.shape[0] - y, x : values.shape[1] - x] for values in (image, truth))
    axis = None if a.ndim == 2 else 2
    if axis and a.shape[2] in (2, 4):
        a, b = a[..., :-1], b[..., :-1]
    ssim = structural_similarity(
        a, b, data_range=1.0, channel_axis=axis, gaussian_weights=True, sigma=1.5, use_sample_covariance=False
    )
    psnr = None if (a == b).all() else float(peak_signal_noise_ratio(b, a, data_range=1.0))
    return {"psnr_db": psnr, "ssim": float(ssim)}


def plain(value: Any, digits: int = 6) -> str:
    """Return a value as text for readers, which is empty for None; of a path, its name."""
    if isinstance(value, dict):
        return ", ".join(f"{key} {plain(item, digits)}" for key, item in value.items())
    if isinstance(value, (list, tuple)):
        return "  ".join(plain(item, digits) for item in value)
    if isinstance(value, Path):
        return value.name
    return "" if value is None else f"{value:.{digits}g}" if isinstance(value, float) else str(value)
