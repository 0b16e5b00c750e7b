"""Every option of :func:`rsdeblur.deblur`, its default and its check.

``rsdeblur --help`` reads the defaults here, so this module imports no heavy library when it is loaded.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, fields
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
    Planning,
    Prior,
    Quality,
    Saturation,
    Solver,
    Strength,
    Transfer,
)
from rsdeblur.errors import InputError

if TYPE_CHECKING:
    from rsdeblur.motion.translation import Translation
    from rsdeblur.types import Denoiser


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

    quality: Quality = "balanced"
    mode: Mode | None = None
    bands: Count = "auto"
    strips: Count = "auto"
    prior: Prior | Denoiser | None = None
    weight: Strength = "auto"
    exponent: float = EXPONENT
    nsr: Strength = "auto"
    noise: Strength = "auto"
    solver: Solver = "auto"
    chroma: Chroma | Auto = "auto"
    geometry: Geometry = "keep"
    border: Border | Boundary | Auto = "auto"
    motion: Motion = "rotation"
    translation: Translation | None = None
    softness: float = 0.0
    refine: bool = False
    transfer: Transfer | Auto = "auto"
    normalize: bool = False
    saturation: Saturation = "auto"
    check: bool = True
    fallback: bool = False
    planning: Planning = "estimate"
    threads: int | None = None
    max_memory: int | None = None

    def __post_init__(self) -> None:
        self._check_choices()
        self._check_numbers()
        self._check_combinations()

    def _check_choices(self) -> None:
        from rsdeblur._util import validate

        validate.choice("quality", self.quality, tuple(choices.QUALITIES))
        allowed: dict[str, Collection[str]] = {
            "solver": choices.SOLVERS,
            "chroma": ("auto", *choices.CHROMAS),
            "geometry": choices.GEOMETRIES,
            "border": ("auto", *choices.BORDERS, *choices.BOUNDARIES),
            "motion": choices.MOTIONS,
            "saturation": choices.SATURATIONS,
            "planning": choices.PLANNINGS,
        }
        if self.mode is not None:
            allowed["mode"] = choices.MODES
        if self.prior is not None and not callable(self.prior):
            allowed["prior"] = choices.PRIORS
        for name, values in allowed.items():
            validate.choice(name, getattr(self, name), values)
        for name in ("refine", "normalize", "check", "fallback"):
            validate.boolean(name, getattr(self, name))

    def _check_numbers(self) -> None:
        from rsdeblur._util import validate
        from rsdeblur.image.transfer import check_transfer

        checked: dict[str, object] = {}
        for name in ("bands", "strips"):
            if not validate.is_auto(getattr(self, name)):
                checked[name] = validate.count(name, getattr(self, name))
        for name in ("nsr", "weight"):
            if not validate.is_auto(getattr(self, name)):
                checked[name] = validate.strength(name, getattr(self, name))
        if not validate.is_auto(self.noise):
            checked["noise"] = validate.noise("noise", self.noise)
        checked["exponent"] = validate.exponent(self.exponent)
        checked["softness"] = validate.softness(self.softness)
        for name in ("threads", "max_memory"):
            if getattr(self, name) is not None:
                checked[name] = validate.count(name, getattr(self, name))
        if not validate.is_auto(self.transfer):
            checked["transfer"] = check_transfer(self.transfer)
        if self.translation is not None:
            from rsdeblur.motion.translation import Translation

            validate.instance("translation", self.translation, Translation)
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    def _check_combinations(self) -> None:
        from rsdeblur._util import validate

        mode, prior, boundary = self.mode_in_effect, self.prior_in_effect, self.boundary_in_effect
        if prior == "wiener" and not validate.is_auto(self.weight):
            raise InputError('prior="wiener" has no weight: give nsr, or another prior')
        if prior != "hyper-laplacian" and self.exponent != EXPONENT:
            raise InputError(f'exponent belongs to prior="hyper-laplacian", but prior is {self.prior_name!r}')
        if mode == "rowwise" and boundary is not None:
            given = f'quality="{self.quality}"' if self.mode is None else 'mode="rowwise"'
            raise InputError(
                f'{given} takes no border="{boundary}", because it solves for the rows beyond the frame; '
                'use border="blend" or "periodic"'
            )
        if boundary == "unknown" and prior == "wiener":
            raise InputError(
                'prior="wiener" takes no border="unknown", which needs a prior that takes several steps; use '
                'border="blend", or another prior'
            )
        if self.chroma == "half" and not self._may_halve_chroma:
            raise InputError(
                'chroma="half" goes with mode "banded" or "global", prior "wiener", "gradient", "tv" or '
                f'"hyper-laplacian", and no border="unknown", but mode is "{mode}", prior {self.prior_name!r} and '
                f'border "{self.border}"; use chroma="auto"'
            )
        if self.fallback and self.geometry == "rectify":
            raise InputError(
                'fallback=True blends with the input, but geometry="rectify" changes its shape; use geometry="keep"'
            )
        whole = {
            'geometry="rectify"': self.geometry == "rectify",
            "refine=True": self.refine,
            "normalize=True": self.normalize,
            f'border="{boundary}"': boundary is not None,
        }
        for text, needs_all in whole.items():
            if self.max_memory is not None and needs_all:
                raise InputError(f"{text} needs the whole picture at once: leave out max_memory or {text}")

    @property
    def mode_in_effect(self) -> Mode:
        """The mode that was given, or that of the quality."""
        return choices.QUALITIES[self.quality][0] if self.mode is None else self.mode

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
        is_default = prior in ("tv", "hyper-laplacian") or (prior == "wiener" and self.quality == "fast")
        halves = self.chroma == "half" or (self.chroma == "auto" and self._may_halve_chroma and is_default)
        return "half" if halves else "full"

    @property
    def border_in_effect(self) -> Border:
        """The continuation of the picture beyond its frame that the solver is planned with."""
        return "blend" if self.border in ("auto", "blend") else "periodic"

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
        suited = self.prior_in_effect in ("wiener", "gradient", "tv", "hyper-laplacian")
        return suited and self.mode_in_effect != "rowwise" and self.border != "unknown"
