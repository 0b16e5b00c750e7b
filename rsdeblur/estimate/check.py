"""Check of a result without a reference: whether the motion explains the blurred picture, and whether the result rings.

To blur the result again proves little: a wrong PSF that was divided out gives the input again. Two other tests do prove
something. The first is what the blurred picture says of the motion (:mod:`rsdeblur.estimate.motion_evidence`). The
second is light below black: a wrong inverse leaves waves, which in dark places fall below zero.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from rsdeblur._util.one_line import one_line
from rsdeblur.choices import Verdict
from rsdeblur.estimate.cepstrum import cepstral_match
from rsdeblur.estimate.motion_evidence import SIZES, MotionEvidence
from rsdeblur.estimate.refine import Refinement
from rsdeblur.estimate.search import OTHER_AXES
from rsdeblur.image.encoded import EncodedImage
from rsdeblur.image.mending import UndershootMeter


class Bounds(NamedTuple):
    """Values from which a figure is doubtful, and bad; and one beyond which the motion is right in any case."""

    doubtful: float
    bad: float
    clear: float = np.nan


class Alternative(NamedTuple):
    """What is said where an alternative explains the picture better, and when that does not count."""

    hint: str
    is_harmless: bool = False  # does not make a result bad
    refuted: float | None = None  # not even doubtful where log l1 / l2 is so much smaller with the motion


# Lead of the motion over the best alternative, nats per tile; light below black as a share of the picture's contrast;
# and the fall of log l1 / l2 of the gradient under the motion turned by half a turn. Where the motion is clearly right,
# twice the ringing is allowed, because hard edges on black ring in any case. docs/developer/reliability.md says how
# they were chosen and how often they are right (`python -m benchmarks.verdict`).
LEAD = Bounds(-1.5, -7.25, clear=2.0)
RINGING = Bounds(0.045, 0.17)
TURN = Bounds(0.01, 0.05, clear=-0.03)
# Detail below which a result has lost what the blur left, see :class:`QualityCheck`. Results that are better than the
# photo have 1.1 and more (`python -m benchmarks.verdict --phone --new --records FILE` keeps it for each); fog has less.
LEAST_DETAIL = 0.65
# Cepstral match below which a result has waves or grain. Where an alternative leads, results that are better by 2 dB
# have 0.06 and more (`python -m benchmarks.verdict --phone --new --records FILE` keeps it for each).
LEAST_MATCH = 0.06
# Gain, nats, and standard deviations from which a change of the focal length that refinement refused makes a result
# doubtful; and the change, as the logarithm of a factor, from which an accepted one does.
REFUSED_GAIN, REFUSED_DEVIATIONS, LARGE_SCALE = 10.0, 3.0, 0.223

# If the motion is too small, too little blur is removed, which does little harm. And the edges of man-made things look
# like a straight blur. Smaller motions leave fewer waves, larger ones more.
ALTERNATIVES = {
    "still": Alternative("no blur at all."),
    "mirrored": Alternative("the motion mirrored: is one of the gyroscope's axes reversed?"),
    "exchanged": Alternative("the motion with x and y exchanged: are the gyroscope's axes right?"),
    "straight": Alternative("a straight blur: is it another moment's motion, or does the scene move?", True, 0.01),
} | {
    f"{size:g} times": Alternative(
        f"{size:g} times the motion: are the focal length and the unit of the rates right?", size > 1, 0.02
    )
    for size in SIZES
}


@one_line()
@dataclass(frozen=True, slots=True)
class QualityCheck:
    """Check of a result of :func:`rsdeblur.deblur`.

    Parameters
    ----------
    verdict : {"good", "cannot tell", "doubtful", "bad"}
        Whether to trust the result; "cannot tell" if it does not ring and nothing else can be judged.
    reasons : tuple of str
        Sentences that explain the verdict, or name what could not be judged.
    lead : float or None
        Log-likelihood of the blurred picture under the motion minus that under the best alternative, in nats per tile,
        where no tile counts for more than 10; negative if the alternative wins, None if it cannot be judged.
    alternative : str or None
        The best alternative; where one makes the result bad, the best of those that can. Straight blurs and other sizes
        of the motion, with which the sharp picture is clearly less clear, do not count otherwise.
    ringing : float
        Light below black that deblurring added, root mean square, as a share of the picture's standard deviation.
    detail : float or None
        Energy of the result's gradient over that of the input's without its noise, both at half size or less.
    half_turn : float or None
        By how much the logarithm of l1 / l2 of the gradient falls if the motion is turned by half a turn about the
        optical axis; positive if the picture becomes sharper so, 0 if it has less than 160 px on its shorter side,
        None if the motion cannot be judged.
    replaced : bool
        Whether the input was returned in place of the result because of this check.
    cepstral_match : float or None
        Correlation of the cepstra of the result and of its PSFs, lowest tenth of the tiles. It is small where the
        result has waves or grain at frequencies that the motion removed, for which the blurred picture does not ask.
        None where the motion leads, for a burst, and where fewer than ten tiles of 128 px show more than noise.
    """

    verdict: Verdict
    reasons: tuple[str, ...]
    lead: float | None
    alternative: str | None
    ringing: float
    detail: float | None
    half_turn: float | None
    replaced: bool = False
    cepstral_match: float | None = None


def assess(
    evidence: MotionEvidence, result: EncodedImage, meter: UndershootMeter, *, threads: int | None = None
) -> QualityCheck:
    """Check a result, a sharp picture with its readout along y."""
    ringing = meter.ringing()
    if evidence.tiles is None:
        return _with_verdict(QualityCheck("cannot tell", (), None, None, ringing, None, None), evidence.unknown)
    alternative, lead = best_alternative(evidence, threads)
    tiles, turn, match = evidence.tiles, evidence.half_turn, None
    detail = tiles.detail(result, threads=threads)
    if lead < 0 and evidence.frames == 1:  # other frames of a burst show what the motion of the reference removed
        match = cepstral_match(tiles.encoded, result, tiles.capture, tiles.noise, threads=threads)
    check = QualityCheck("cannot tell", (), lead, alternative, ringing, detail, turn, cepstral_match=match)
    return _with_verdict(check)


def best_alternative(evidence: MotionEvidence, threads: int | None) -> tuple[str, float]:
    """Return the best alternative to the motion, and the lead over it, nats per tile; see :class:`QualityCheck`."""
    harmful = {name: lead for name, lead in evidence.leads.items() if not ALTERNATIVES[name].is_harmless}
    compared = harmful if min(harmful.values()) < LEAD.bad else _not_refuted(evidence, threads)
    return min(compared.items(), key=lambda item: item[1])


def _not_refuted(evidence: MotionEvidence, threads: int | None) -> dict[str, float]:
    """Return the leads without those of alternatives that explain the picture better, but make it less clear."""
    # Straight edges look like a straight blur, or like a smaller motion along them.
    least = {name: each.refuted for name, each in ALTERNATIVES.items() if each.refuted is not None}
    better = [name for name, lead in evidence.leads.items() if lead < LEAD.doubtful and name in least]
    clearer = evidence.clearer(better, threads)
    refuted = {name for name, more in zip(better, clearer, strict=True) if more > least[name]}
    return {name: lead for name, lead in evidence.leads.items() if name not in refuted}


def _with_verdict(check: QualityCheck, *reasons: str) -> QualityCheck:
    """Return `check` with the verdict and the reasons that follow from its figures."""
    lead = np.inf if check.lead is None else check.lead
    turn = -np.inf if check.half_turn is None else check.half_turn
    clear = (LEAD.clear < lead < np.inf and turn <= TURN.doubtful) or -np.inf < turn < TURN.clear
    ringing = check.ringing / (2.0 if clear else 1.0)
    # Ringing is NaN in a result that is not finite.
    other = None if check.alternative is None else ALTERNATIVES[check.alternative]
    # What looks harmless is no excuse where half a turn and ringing accuse the motion, too.
    excused = other is not None and other.is_harmless and not (turn > TURN.doubtful and ringing > RINGING.doubtful)
    refuted = lead < LEAD.bad and not excused
    bad = refuted or not ringing <= RINGING.bad or turn > TURN.bad
    unfit = f"The motion {'does' if bad else 'may'} not fit."
    sentences = list(reasons)
    # Edges of one direction look like a straight blur. They are that where half a turn makes the picture clearly worse.
    edges = check.alternative == "straight" and lead >= LEAD.bad and turn < TURN.clear
    if lead < LEAD.doubtful and other and not edges:
        sentences.append(f"{unfit} The picture is explained better by {other.hint}")
    if turn > TURN.doubtful:
        sentences.append(
            f"{unfit} The picture becomes sharper with the motion turned by half a turn: is it upside down, or are two "
            "of the gyroscope's axes reversed?"
        )
    if ringing > RINGING.doubtful:
        sentences.append(f"The result rings: light below black is {check.ringing:.1%} of the picture's contrast.")
    if check.detail is not None and check.detail < LEAST_DETAIL:
        sentences.append("The result has lost the picture's detail: are nsr and weight too large?")
    if check.cepstral_match is not None and check.cepstral_match < LEAST_MATCH:
        sentences.append("The result has waves or grain that the photo does not ask for: is the weight too small?")
    doubtful, unknown = len(sentences) > len(reasons), check.lead is None
    verdict: Verdict = "bad" if bad else "doubtful" if doubtful else "cannot tell" if unknown else "good"
    return replace(check, verdict=verdict, reasons=tuple(sentences))


def doubted_by(refinement: Refinement, check: QualityCheck) -> QualityCheck:
    """Return `check` of a result with a refined recording, doubtful where refinement doubts focal length or axes."""
    scale, accepted = refinement.values.scale, refinement.accepted
    clear = refinement.gain >= REFUSED_GAIN and abs(scale) > REFUSED_DEVIATIONS * refinement.sd.scale
    if refinement.reason == OTHER_AXES:
        reason = f"The axes may be wrong: {OTHER_AXES}"
    elif accepted and not refinement.confidence:
        reason = "The axes may be wrong: a drift that the log lacks makes up much of the motion."
    elif abs(scale) > LARGE_SCALE if accepted else clear:
        factor = f"The focal length may be wrong: the picture asks for {np.exp(scale):.2f} times the given one"
        reason = f"{factor}{'' if accepted else ', but not surely'}."
    else:
        return check
    verdict: Verdict = "doubtful" if check.verdict in ("good", "cannot tell") else check.verdict
    return replace(check, verdict=verdict, reasons=(*check.reasons, reason))
