"""Every option of :func:`rsdeblur.deblur`: its default, its check, and its help on the command line.

The command line makes its options of the fields, so this module imports no heavy library when it is loaded.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

from rsdeblur import choices
from rsdeblur.choices import (
    EXPONENT,
    Auto,
    Border,
    Boundary,
    Chroma,
    Count,
    Geometry,
    Mode,
    Motion,
    Prior,
    Quality,
    Saturation,
    Strength,
    Transfer,
)
from rsdeblur.errors import InputError

if TYPE_CHECKING:
    from rsdeblur.motion.translation import Translation
    from rsdeblur.types import Denoiser


# The sections of the help, in their order.
BLUR, SOLVER, COMPUTING = "Blur", "Solver", "Computing"


def _option(default: Any, section: str | None = None, text: str | None = None, **facts: Any) -> Any:
    """Return a field with its section and text in the help of commands, which have no option for a field without.

    `choices` are the values, `kind` names the check of a number (`_checks`), `modes` are those with an effect, `shown`
    is the default as the help prints it.
    """
    return field(default=default, metadata={"section": section, "help": text, **facts})


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Options of :func:`rsdeblur.deblur`, under the names of its keywords, where they are described.

    Fields hold what was given. What follows from options together has a name that ends in `_in_effect`.

    Raises
    ------
    InputError
        If a value is out of range, or two options exclude each other.

    Examples
    --------
    >>> import rsdeblur
    >>> options = rsdeblur.Options(prior="wiener", nsr=0.02)
    >>> options.mode, options.mode_in_effect, options.prior_in_effect
    (None, 'banded', 'wiener')
    """

    quality: Quality = _option(
        "balanced",
        SOLVER,
        "Mode and prior together: banded with wiener, or auto or rowwise with hyper-laplacian.",
        choices=tuple(choices.QUALITIES),
    )
    mode: Mode | Auto | None = _option(
        None,
        BLUR,
        "One PSF for the picture, per tile, or per row. Auto is banded, or rowwise where the blur changes too much "
        "within its height.",
        choices=("auto", *choices.MODES),
        shown="by --quality",
    )
    bands: Count = _option(
        "auto", BLUR, "Number of bands, which divide the picture along the readout.", kind="count", modes=("banded",)
    )
    strips: Count = _option(
        "auto",
        BLUR,
        "Number of strips, which divide it across the readout.",
        kind="count",
        modes=("banded", "rowwise"),
    )
    prior: Prior | Denoiser | None = _option(
        None,
        SOLVER,
        "Assumption about sharp pictures; wiener is the published filter, and the fastest.",
        choices=choices.PRIORS,
        shown="by --quality",
    )
    weight: Strength = _option(
        "auto", SOLVER, "Weight of the prior (not wiener): a higher one gives a smoother picture.", kind="strength"
    )
    exponent: float = _option(EXPONENT, SOLVER, "Exponent of the hyper-Laplacian.", kind="exponent", shown="2/3")
    nsr: Strength = _option(
        "auto", SOLVER, "Noise-to-signal ratio: a higher one gives a smoother picture.", kind="strength"
    )
    noise: Strength = _option(
        "auto",
        SOLVER,
        "Standard deviation of the noise in linear light, where white is 1; auto estimates it.",
        kind="noise",
    )
    chroma: Chroma | Auto = _option(
        "auto",
        SOLVER,
        "Resolution of the colours: full, or half as in JPEG, in less time; auto is half for tv and hyper-laplacian, "
        "and with --quality fast.",
        choices=("auto", *choices.CHROMAS),
    )
    geometry: Geometry = _option(
        "keep", BLUR, "Keep the rolling-shutter shape, or straighten it.", choices=choices.GEOMETRIES
    )
    border: Border | Boundary | Auto = _option(
        "auto",
        SOLVER,
        "Picture beyond the frame: blended, periodic or unknown; auto is unknown for --psf, otherwise blend.",
        choices=("auto", *choices.BORDERS, *choices.BOUNDARIES),
    )
    motion: Motion = _option(
        "rotation", BLUR, "Full rotation, or small angles about x and y only.", choices=choices.MOTIONS
    )
    translation: Translation | None = None
    softness: float = _option(
        0.0,
        BLUR,
        "Blur of lens, pixels and demosaicing to undo as well: the standard deviation of a Gaussian, up to 1 px.",
        kind="softness",
    )
    refine: bool = _option(
        False, BLUR, "Correct focal length, clock, readout and motion by the picture first; takes some seconds."
    )
    transfer: Transfer | Auto = _option(
        "auto",
        SOLVER,
        "How pixel values encode light; auto means srgb for 8 and 16 bits, linear for floating point.",
        kind="transfer",
    )
    normalize: bool = _option(False, SOLVER, "Compress light that exceeds the range into it, at the price of contrast.")
    saturation: Saturation = _option(
        "auto",
        SOLVER,
        "Solve without clipped highlights and add them afterwards, which leaves fewer streaks: always, or (auto) by "
        "night and where small ones cover at most 0.5% of the picture, except with --quality fast and --max-memory.",
        choices=choices.SATURATIONS,
    )
    check: bool = _option(True)
    fallback: bool = _option(False, SOLVER, "Keep the photo as it is if the check finds the result bad.")
    threads: int | None = _option(None, COMPUTING, "Number of threads.  [default: all cores]", kind="threads")
    max_memory: int | None = _option(
        None,
        COMPUTING,
        "Memory for the work, without the picture and its result, like 1GiB; little memory takes longer.",
        kind="memory",
    )

    def __post_init__(self) -> None:
        self._check_values()
        self._check_combinations()

    def _check_values(self) -> None:
        from rsdeblur._util import validate

        checks = _checks()
        for each in fields(self):
            name, value, facts = each.name, getattr(self, each.name), each.metadata
            if (value is None and each.default is None) or (name == "prior" and callable(value)):
                continue
            if isinstance(each.default, bool):
                validate.boolean(name, value)
            elif "choices" in facts:
                validate.choice(name, value, facts["choices"])
            elif "kind" in facts and not (each.default == "auto" and validate.is_auto(value)):
                object.__setattr__(self, name, checks[facts["kind"]](name, value))
        if self.translation is not None:
            from rsdeblur.motion.translation import Translation

            validate.instance("translation", self.translation, Translation)

    def _check_combinations(self) -> None:
        from rsdeblur._util import validate

        mode, prior, boundary = self.mode_in_effect, self.prior_in_effect, self.boundary_in_effect
        if prior == "wiener" and not validate.is_auto(self.weight):
            raise InputError("the prior wiener has no weight: give nsr, or another prior", "weight")
        if prior != "hyper-laplacian" and self.exponent != EXPONENT:
            raise InputError(
                f"exponent belongs to the prior hyper-laplacian, but the prior is {self.prior_name}", "exponent"
            )
        if mode == "rowwise" and boundary is not None:
            given = f"the quality {self.quality}" if self.mode is None else "the mode rowwise"
            raise InputError(
                f"{given} takes no border {boundary}, because it solves for the rows beyond the frame; use the border "
                "blend or periodic",
                "border",
            )
        if boundary == "unknown" and prior == "wiener":
            raise InputError(
                "the prior wiener takes no border unknown, which needs a prior that takes several steps; use the "
                "border blend, or another prior",
                "border",
            )
        if self.chroma == "half" and not self._may_halve_chroma:
            raise InputError(
                "half colours go with the priors wiener, gradient, tv and hyper-laplacian, and no border unknown, but "
                f"the prior is {self.prior_name} and the border {self.border}; use the chroma auto",
                "chroma",
            )
        if self.fallback and self.geometry == "rectify":
            raise InputError(
                "fallback returns the input, but the geometry rectify changes its shape; use the geometry keep",
                "fallback",
            )
        whole = {
            "geometry rectify": self.geometry == "rectify",
            "refine": self.refine,
            "normalize": self.normalize,
            "saturation always": self.saturation == "always",
            f"border {boundary}": boundary is not None,
        }
        for text, needs_all in whole.items():
            if self.max_memory is not None and needs_all:
                raise InputError(
                    f"{text} needs the whole picture at once: leave out max_memory or {text}", "max_memory"
                )

    @property
    def mode_in_effect(self) -> Mode:
        """The mode that was given, or that of the quality; "banded" where the motion has not chosen yet."""
        mode = choices.QUALITIES[self.quality][0] if self.mode is None else self.mode
        return "banded" if mode == "auto" else mode

    @property
    def mode_is_open(self) -> bool:
        """Whether the motion chooses the mode. Numbers of bands, and a border that rows do not take, choose tiles."""
        mode = choices.QUALITIES[self.quality][0] if self.mode is None else self.mode
        return mode == "auto" and self.bands == "auto" and self.boundary_in_effect is None

    @property
    def prior_in_effect(self) -> Prior | Denoiser:
        """The prior that was given, or that of the quality."""
        return choices.QUALITIES[self.quality][1] if self.prior is None else self.prior

    @property
    def chroma_in_effect(self) -> Chroma:
        """The resolution of the colours, where pictures and blur permit half of it.

        The results of "wiener", the published method, and "gradient" are linear in the picture, unless chroma="half" or
        quality="fast" asks for half.
        """
        prior = self.prior_in_effect
        is_sparse = prior in choices.DERIVATIVE_PRIORS and prior not in choices.LINEAR_PRIORS
        is_default = is_sparse or (prior == "wiener" and self.quality == "fast")
        halves = self.chroma == "half" or (self.chroma == "auto" and self._may_halve_chroma and is_default)
        return "half" if halves else "full"

    @property
    def boundary_in_effect(self) -> Boundary | None:
        """The border if it is "unknown"; None if the solver continues the picture itself."""
        border = self.border
        return None if border == "auto" or border == "blend" or border == "periodic" else border

    @property
    def saturation_in_effect(self) -> Saturation:
        """The treatment of clipped highlights; "auto" ignores them where time or memory is short."""
        is_short = self.quality == "fast" or self.max_memory is not None
        return "ignore" if self.saturation == "auto" and is_short else self.saturation

    @property
    def has_one_psf(self) -> bool:
        """Whether one PSF is undone in the whole picture."""
        mode = self.mode_in_effect
        return mode == "global" or (mode == "banded" and self.bands == self.strips == 1)

    @property
    def prior_name(self) -> str:
        """Name of the prior for reports."""
        prior = self.prior_in_effect
        return getattr(prior, "__name__", "denoiser") if callable(prior) else prior

    @property
    def judges(self) -> bool:
        """Whether the result is checked."""
        return self.check or self.fallback

    @property
    def recorded(self) -> dict[str, Any]:
        """All options by name, as reports and histories record them: with the mode and the prior in effect."""
        given = {field.name: getattr(self, field.name) for field in fields(self)}
        return given | {"mode": self.mode_in_effect, "prior": self.prior_in_effect}

    @property
    def _may_halve_chroma(self) -> bool:
        return self.prior_in_effect in ("wiener", *choices.DERIVATIVE_PRIORS) and self.border != "unknown"


def _checks() -> dict[str, Callable[[str, Any], Any]]:
    """Return the check of each kind of number, which returns the number."""
    from rsdeblur._util import validate
    from rsdeblur.image.transfer import check_transfer

    return {
        "count": validate.count,
        "strength": validate.strength,
        "noise": validate.noise,
        "exponent": validate.exponent,
        "softness": validate.softness,
        "transfer": lambda _, value: check_transfer(value),
        "threads": validate.count,
        "memory": validate.count,
    }
