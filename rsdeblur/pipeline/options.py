"""Every option of :func:`rsdeblur.deblur`, its default and its check.

``rsdeblur --help`` reads the defaults here, so this module imports no heavy library when it is loaded.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from rsdeblur import choices
from rsdeblur.choices import (
    BY_QUALITY,
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

    Raises
    ------
    InputError
        If a value is out of range, or two options exclude each other.

    Examples
    --------
    >>> import rsdeblur
    >>> options = rsdeblur.Options(prior="wiener", nsr=0.02)
    >>> options.mode, options.prior
    ('banded', 'wiener')
    """

    quality: Quality = "balanced"
    mode: Mode = BY_QUALITY
    bands: Count = "auto"
    strips: Count = "auto"
    prior: Prior | Denoiser = BY_QUALITY
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
    saturation: Saturation = "ignore"
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
        for name, chosen in zip(("mode", "prior"), choices.QUALITIES[self.quality], strict=True):
            if getattr(self, name) is BY_QUALITY:
                object.__setattr__(self, name, chosen)
        allowed = {
            "mode": choices.MODES,
            "solver": choices.SOLVERS,
            "chroma": ("auto", *choices.CHROMAS),
            "geometry": choices.GEOMETRIES,
            "border": ("auto", *choices.BORDERS, *choices.BOUNDARIES),
            "motion": choices.MOTIONS,
            "saturation": choices.SATURATIONS,
            "planning": choices.PLANNINGS,
        }
        for name, values in allowed.items():
            validate.choice(name, getattr(self, name), values)
        if not callable(self.prior):
            validate.choice("prior", self.prior, choices.PRIORS)
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

        if self.prior == "wiener" and not validate.is_auto(self.weight):
            raise InputError('prior="wiener" has no weight: give nsr, or another prior')
        if self.prior != "hyper-laplacian" and self.exponent != EXPONENT:
            raise InputError(f'exponent belongs to prior="hyper-laplacian", but prior is {self.prior_name!r}')
        if self.mode == "rowwise" and self.boundary is not None:
            by_quality = choices.QUALITIES[self.quality][0] == self.mode
            given = f'quality="{self.quality}"' if by_quality else 'mode="rowwise"'
            raise InputError(
                f'{given} takes no border="{self.border}", because it solves for the rows beyond the frame; '
                'use border="blend" or "periodic"'
            )
        if self.border == "unknown" and self.prior == "wiener":
            raise InputError(
                'prior="wiener" takes no border="unknown", which needs a prior that takes several steps; use '
                'border="smooth", or another prior'
            )
        if self.chroma == "half" and not self._may_halve_chroma:
            raise InputError(
                'chroma="half" goes with mode "banded" or "global", prior "wiener", "gradient", "tv" or '
                f'"hyper-laplacian", and no border="unknown", but mode is "{self.mode}", prior {self.prior_name!r} and '
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
            f'border="{self.border}"': self.boundary is not None,
        }
        for text, needs_all in whole.items():
            if self.max_memory is not None and needs_all:
                raise InputError(f"{text} needs the whole picture at once: leave out max_memory or {text}")

    @property
    def prior_name(self) -> str:
        """Name of the prior for reports."""
        return getattr(self.prior, "__name__", "denoiser") if callable(self.prior) else self.prior

    @property
    def judges(self) -> bool:
        """Whether the result is checked."""
        return self.check or self.fallback

    @property
    def chroma_in_effect(self) -> Chroma:
        """The resolution of the colours, where pictures and blur permit half of it.

        The results of "wiener", the published method, and "gradient" are linear in the picture, unless chroma="half" or
        quality="fast" asks for half.
        """
        is_fast = self.prior == "wiener" and self.quality == "fast"
        is_default = is_fast or self.prior in ("tv", "hyper-laplacian")
        halves = self.chroma == "half" or (self.chroma == "auto" and self._may_halve_chroma and is_default)
        return "half" if halves else "full"

    @property
    def _may_halve_chroma(self) -> bool:
        suited = self.prior in ("wiener", "gradient", "tv", "hyper-laplacian")
        return suited and self.mode != "rowwise" and self.border != "unknown"

    @property
    def mode_in_effect(self) -> Mode:
        """The mode; a single band and strip count as the global mode."""
        return "global" if self.mode == "banded" and self.bands == self.strips == 1 else self.mode

    @property
    def solver_border(self) -> Border:
        """The continuation of the picture beyond its frame that the solver is planned with."""
        return "blend" if self.border in ("auto", "blend") else "periodic"

    @property
    def boundary(self) -> Boundary | None:
        """The method that makes the picture periodic before it is solved; None if the solver does so itself."""
        border = self.border
        return None if border == "auto" or border == "blend" or border == "periodic" else border
