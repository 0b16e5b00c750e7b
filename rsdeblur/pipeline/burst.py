"""Several frames of one scene, shaken differently, deblurred together: :func:`rsdeblur.deblur_burst`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur.choices import Auto
from rsdeblur.deconv.burst import BurstQuadratic, RowBurst
from rsdeblur.deconv.priors import brightness
from rsdeblur.deconv.wiener import TileBlur
from rsdeblur.errors import InputError
from rsdeblur.estimate.check import UndershootMeter, assess, fall_back
from rsdeblur.estimate.strength import KERNELS, Spectra, Tuning
from rsdeblur.image.encoded import EncodedImage, check_size, result_like
from rsdeblur.image.frame import ReadoutFrame
from rsdeblur.image.highlights import HighlightSplit
from rsdeblur.motion.alignment import Alignment, burst_captures
from rsdeblur.motion.arguments import check_recording
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.motion.paths import Capture
from rsdeblur.motion.rectify import rectify
from rsdeblur.pipeline.burst_frames import FIT_TILES, BurstFrame, reduced_bank
from rsdeblur.pipeline.memory import Chunk, least_memory
from rsdeblur.pipeline.options import Options
from rsdeblur.pipeline.plan import DeblurResult
from rsdeblur.pipeline.settings import SolverSettings
from rsdeblur.pipeline.stages import StageClock
from rsdeblur.pipeline.steps import solve_chunks, tuned_part, tuned_strengths
from rsdeblur.pipeline.tiles import tile_error, tile_paths
from rsdeblur.psf import PsfBank, tile_centres
from rsdeblur.types import Float32Array, FloatArray, FloatImage, Progress, StageProgress

# A frame whose mean weight over the reference's detail is less contributes nothing: its motion or its scene is another.
LEAST_SUPPORT = 0.5
# Mean weight over a whole frame from which on it shows the same scene everywhere.
ALIKE = 0.99
# Most frames of a burst.
MOST_FRAMES = 64
# Bytes that the solve may use by default: with eight frames of 12 megapixels, their PSFs and Python, the private memory
# of a process then stays below 2 GiB. The default grows to this multiple of what the smallest chunks need.
MEMORY, ABOVE_LEAST = 1 << 30, 1.25


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class FrameUse:
    """What a frame contributed to a result of :func:`rsdeblur.deblur_burst`.

    Parameters
    ----------
    share : float
        Share of the frame in the data, from 0 to 1: the inverse of its noise power, model errors included, divided by
        the sum over all frames. 0 if the frame was left out.
    support : float
        Mean weight over the reference's detail, from 0 to 1. A frame below 0.5 is left out.
    gain : float
        Brightness of the frame in units of the reference's.
    shift : float
        Root mean square of the shift that rotation does not explain, px.
    noise : float
        Standard deviation of its noise in linear light.
    blur : float
        Root mean square radius of its PSFs, px.
    weights : ndarray, shape (h, w), float32
        Weight from 0 to 1 at each place of the reference as stored, reduced by a whole factor; 0 where the frame does
        not show the place.
    """

    share: float
    support: float
    gain: float
    shift: float
    noise: float
    blur: float
    weights: Float32Array


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class BurstResult:
    """A picture deblurred from several frames.

    Parameters
    ----------
    result : DeblurResult
        The sharp picture in the pose of the reference, and what was used for it; `psfs` are those of the reference.
    reference : int
        Index of the reference, from 0.
    frames : tuple of FrameUse
        What each frame contributed, in the order of the input.
    """

    result: DeblurResult
    reference: int
    frames: tuple[FrameUse, ...]

    @property
    def image(self) -> NDArray[Any]:
        """The sharp picture, see :class:`rsdeblur.DeblurResult`."""
        return self.result.image


def deblur_burst(
    images: Sequence[ArrayLike],
    log: GyroLog,
    camera: Camera,
    exposures: Sequence[Exposure],
    *,
    reference: int | Auto = "auto",
    out: NDArray[Any] | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> BurstResult:
    """Deblur several frames of one scene together.

    Each shaken frame has lost other frequencies; together they have almost all. The rotation between the frames follows
    from the log, a residual shift from the pictures. A frame counts by the inverse of its noise power, to which the
    errors of its motion add, and nowhere where it does not show the same scene: there the result is that of the
    remaining frames.

    Parameters
    ----------
    images : sequence of array_like, shape (H, W) or (H, W, C)
        At least two frames of one camera, as for :func:`rsdeblur.deblur`. Their brightness may differ.
    log : GyroLog
        Motion, from the first exposure to the last one.
    camera : Camera
        The camera of all frames.
    exposures : sequence of Exposure
        When each frame was exposed and for how long; durations may differ.
    reference : int or "auto"
        Index of the frame whose pose the result has; "auto" takes the frame that alone promises the least error, among
        those that most others agree with.
    out : ndarray, optional
        Receives the result, see :func:`rsdeblur.deblur`.
    progress : callable, optional
        Called as ``progress(stage, fraction)``.
    **options
        Fields of :class:`rsdeblur.Options`. ``motion="small-angle"``, ``refine=True``, ``saturation="auto"`` and
        borders other than "blend" and "periodic" are not possible. By default the work uses
        some 1 GiB in addition to the pictures, and more where the blur of many large frames is so tall that even a
        few rows need more, or where ``geometry="rectify"`` or ``normalize=True`` needs the whole picture at once.

    Returns
    -------
    BurstResult
        The sharp picture, and what each frame contributed.

    Raises
    ------
    InputError
        If an argument is out of range, there are fewer than two frames, their sizes differ, or as
        :func:`rsdeblur.deblur`.
    CoverageError, ClockError, GapError
        If the log does not cover the exposures and the times between them.

    Examples
    --------
    >>> import rsdeblur
    >>> log = rsdeblur.hand_shake(0.4, strength=0.3, seed=3)
    >>> camera = rsdeblur.Camera(96, 72, 150.0, readout_time=0.01)
    >>> exposures = [rsdeblur.Exposure(start, 1 / 40) for start in (0.1, 0.2)]
    >>> scene = rsdeblur.scene(110, 140)
    >>> images = [rsdeblur.simulate(scene, log, camera, exposure).blurred for exposure in exposures]
    >>> burst = rsdeblur.deblur_burst(images, log, camera, exposures, prior="wiener")
    >>> burst.image.shape, len(burst.frames)
    ((72, 96, 3), 2)
    """
    chosen = Options(**options)
    check_burst(images, log, camera, exposures, chosen)
    if not validate.is_auto(reference):
        reference = validate.count("reference", reference, minimum=0, maximum=len(images) - 1)
    clock = StageClock(validate.callback("progress", progress))
    frame = ReadoutFrame(camera)
    encoded = [EncodedImage.of(image, chosen.transfer, frame) for image in images]
    out, upright = result_like(images[0], out, frame)
    translation = chosen.translation
    if translation is not None and frame.quarter:
        translation = translation.turned()
    captures = burst_captures(log, frame.camera, exposures, translation, softness=chosen.softness)
    with clock.stage("tune"):
        tunings = [_tuning(e, capture, chosen) for e, capture in zip(encoded, captures, strict=True)]
    with clock.stage("align"):
        burst = _align(encoded, captures, tunings, reference, clock)
    with clock.stage("psfs"):
        solution = _Solution.of(burst, chosen)
    coverage, meter = solution.run(upright, chosen, clock)
    check = None
    if chosen.check or chosen.fallback:
        with clock.stage("check"):
            source = burst.reference.encoded
            result = EncodedImage(upright, source.transfer)
            resampled = chosen.geometry == "rectify"
            check = assess(source, result, captures[burst.index], meter, resampled=resampled, threads=chosen.threads)
            if chosen.fallback and check.verdict == "bad":
                check = fall_back(source, check, upright)
    bank, strengths = solution.banks[0], solution.together
    shares = dict(zip(burst.used, solution.shares, strict=True))
    return BurstResult(
        DeblurResult(
            image=out,
            psfs=frame.bank(bank),
            bands=bank.kernels.shape[0],
            strips=bank.kernels.shape[1],
            nsr=strengths.nsr,
            weight=strengths.weight,
            coverage=frame.back(coverage),
            timings=clock.timings,
            check=check,
            noise=solution.noise,
        ),
        burst.index,
        tuple(_use(burst, n, shares.get(n, 0.0), frame) for n in range(len(images))),
    )


def check_burst(
    images: Sequence[ArrayLike], log: GyroLog, camera: Camera, exposures: Sequence[Exposure], options: Options
) -> None:
    """Raise `InputError` unless the frames are those of a burst that can be solved with these options."""
    if len(images) < 2 or len(images) > MOST_FRAMES:
        raise InputError(f"a burst needs 2 to {MOST_FRAMES} frames, got {len(images)}")
    if len(images) != len(exposures):
        raise InputError(f"each frame needs an exposure, got {len(images)} frames and {len(exposures)} exposures")
    for n, (image, exposure) in enumerate(zip(images, exposures, strict=True)):
        check_recording(log, camera, exposure)
        try:
            shape = EncodedImage.of(image, options.transfer).values.shape
            check_size(shape, camera)
        except InputError as error:
            raise InputError(f"frame {n}: {error}") from error
        if np.shape(image) != np.shape(images[0]):
            raise InputError(f"frame {n} has shape {np.shape(image)}, frame 0 has {np.shape(images[0])}")
    unsuited = {
        'motion="small-angle"': options.motion == "small-angle",
        "refine=True": options.refine,
        'saturation="auto"': options.saturation == "auto",
        f'border="{options.border}"': options.boundary is not None,
    }
    for text, is_set in unsuited.items():
        if is_set:
            raise InputError(f"a burst cannot be deblurred with {text}; leave it out, or deblur the frames one by one")


def _tuning(encoded: EncodedImage, capture: Capture, options: Options) -> Tuning:
    """Measure a frame on its own."""
    height, width, _ = encoded.shape
    paths = tile_paths(capture, "banded", min(KERNELS, height), min(KERNELS, width), 1.0)
    noise = None if options.noise == "auto" else options.noise
    rows, bank = tuned_part(encoded.shape, PsfBank.from_paths(paths, threads=options.threads))
    mode = options.mode
    return Tuning.of(encoded.linear(rows), bank, noise=noise, one_filter=mode == "global", continued=mode != "rowwise")


@dataclass(frozen=True, slots=True, eq=False)
class _Burst:
    """Frames aligned with the reference."""

    index: int
    frames: tuple[BurstFrame, ...]

    @property
    def reference(self) -> BurstFrame:
        return self.frames[self.index]

    @property
    def used(self) -> list[int]:
        """Indices of the frames that contribute, the reference first."""
        others = [n for n, frame in enumerate(self.frames) if frame.fit and frame.fit.support >= LEAST_SUPPORT]
        return [self.index, *others]

    @property
    def agreement(self) -> float:
        """Sum of the supports of all other frames."""
        return sum(frame.fit.support for frame in self.frames if frame.fit)


def _align(
    encoded: Sequence[EncodedImage],
    captures: Sequence[Capture],
    tunings: Sequence[Tuning],
    reference: int | Auto,
    clock: StageClock,
) -> _Burst:
    """Fit all frames to the reference, or to the best candidate that most others agree with."""
    if not validate.is_auto(reference):
        candidates = [int(reference)]
    else:
        energy = float(np.mean([tuning.energy for tuning in tunings]))
        errors = [tuning.restoration_error(energy) for tuning in tunings]
        candidates = [int(n) for n in np.argsort(errors, kind="stable")]
    best: _Burst | None = None
    for index in candidates:
        burst = _fitted(index, encoded, captures, tunings, clock)
        if best is None or burst.agreement > best.agreement:
            best = burst
        if 2 * (len(burst.used) - 1) >= len(encoded) - 1:
            break
    assert best is not None
    return best


def _fitted(
    index: int,
    encoded: Sequence[EncodedImage],
    captures: Sequence[Capture],
    tunings: Sequence[Tuning],
    clock: StageClock,
) -> _Burst:
    frames = [
        BurstFrame(picture, Alignment(capture, captures[index]), tuning)
        for picture, capture, tuning in zip(encoded, captures, tunings, strict=True)
    ]
    reference = frames[index]
    height, width, _ = reference.encoded.shape
    rows, cols = (tile_centres(min(tiles, n), n) for tiles, n in zip(FIT_TILES, (height, width), strict=True))
    report = clock.within("align")
    banks = [reduced_bank(frame.alignment.paths(rows, cols), reference.factor) for frame in frames]
    shares = []
    for n, frame in enumerate(frames):
        if n != index:
            fit = frame.fitted(reference, (banks[n], banks[index]))
            share = frame.tuning.path_error_share(reference.tuning, fit.path_error * frame.factor**2)
            tuning = replace(frame.tuning, noise=frame.tuning.noise / fit.gain).with_path_errors(share)
            frames[n] = replace(frame, fit=fit, tuning=tuning)
            if fit.support >= LEAST_SUPPORT:
                shares.append(share)
        report((n + 1) / len(frames))
    # The errors of the reference are in all differences, so they are not larger than the least of these.
    tuning = reference.tuning.with_path_errors(min(shares, default=0.0))
    frames[index] = replace(reference, tuning=tuning)
    return _Burst(index, tuple(frames))


@dataclass(frozen=True, slots=True, eq=False)
class _Solution:
    """Everything that a burst is solved with; the reference comes first."""

    frames: tuple[BurstFrame, ...]
    banks: tuple[PsfBank, ...]
    shares: tuple[float, ...]
    together: SolverSettings
    alone: SolverSettings
    noise: float | None

    @classmethod
    def of(cls, burst: _Burst, options: Options) -> _Solution:
        """Derive the shares and strengths of the frames that contribute, and their PSFs."""
        frames = tuple(burst.frames[n] for n in burst.used)
        mode = "global" if options.mode == "banded" and options.bands == options.strips == 1 else options.mode
        height, width, _ = burst.reference.encoded.shape
        few = _banks(frames, *(tile_centres(min(KERNELS, n), n) for n in (height, width)))
        few = [bank.padded(_largest(few)) for bank in few]
        spectra = [Spectra.of(bank, one_filter=mode == "global") for bank in few]
        tunings = [replace(frame.tuning, spectra=of) for frame, of in zip(frames, spectra, strict=True)]
        errors = [tile_error(frame.alignment.capture) if mode == "banded" else 0.0 for frame in frames]
        tuning, shares = Tuning.of_burst(tunings, tile_errors=errors)
        peak = brightness(HighlightSplit(burst.reference.encoded).remainder(slice(None), 4))
        strengths, nsr = tuned_strengths(tuning, options, peak)
        # Where other frames do not show the scene, they repeat the result of the reference alone. For narrow margins, a
        # Wiener filter is good enough; for things that move, it costs up to 0.6 dB (tv, eight simulated bursts).
        alike = len(frames) > 1 and all(frame.fit is None or frame.fit.weights.mean() > ALIKE for frame in frames)
        simple = replace(options, prior="wiener", nsr="auto", weight="auto") if alike else options
        alone, _ = tuned_strengths(tunings[0], simple, peak)
        own = [tile_paths(f.alignment.capture, mode, options.bands, options.strips, nsr) for f in frames]
        bands, strips = (max(len(getattr(paths, axis)) for paths in own) for axis in ("rows", "cols"))
        banks = _banks(frames, tile_centres(bands, height), tile_centres(strips, width))
        # Chunks reach as far as the largest PSF of any frame. Those of the others stay small until they are used.
        banks[0] = banks[0].padded(_largest(banks))
        settings = SolverSettings.of(options, mode, strengths)
        single = SolverSettings.of(simple, mode, alone)
        return cls(frames, tuple(banks), shares, settings, single, strengths.noise)

    def run(self, out: NDArray[Any], options: Options, clock: StageClock) -> tuple[NDArray[np.bool_], UndershootMeter]:
        """Solve chunk by chunk into `out`, which is upright; return a mask of the pixels that were exposed."""
        reference = self.frames[0]
        meter = UndershootMeter(reference.encoded.shape[0])
        coverage: NDArray[np.bool_] = np.broadcast_to(np.True_, reference.encoded.shape[:2])

        def rectified(light: FloatImage) -> FloatImage:
            nonlocal coverage
            with clock.stage("rectify"):
                light, coverage = rectify(light, reference.alignment.capture)
            return light

        whole = options.geometry == "rectify" or options.normalize
        memory = None if whole else self._memory(options.max_memory)
        solve_chunks(
            HighlightSplit(reference.encoded),
            *(out, self.banks[0], replace(options, max_memory=memory), self.together, clock),
            plan_solver=lambda chunk, _: partial(self._solve, chunk),
            frames=len(self.frames),
            meter=meter,
            finish=rectified if options.geometry == "rectify" else None,
        )
        return coverage, meter

    def _memory(self, most: int | None) -> int:
        """Return the bytes that a chunk may take."""
        if most is not None:
            return most
        # Nobody asked for a bound, so it is no reason to refuse, or to solve slivers with wide margins.
        least = least_memory(self.banks[0], self.frames[0].encoded.shape, self.together, len(self.frames))
        return max(MEMORY, int(ABOVE_LEAST * least))

    def _solve(self, chunk: Chunk, light: FloatImage, progress: StageProgress) -> FloatImage:
        """Return the sharp light of a chunk of rows; `light` is that of the reference, which is solved alone first."""
        first, capture = chunk.source.start, self.frames[0].alignment.capture
        alone = self.alone.plan_solver(capture, _cut(self.banks[0], chunk), light.shape, first)
        single = alone(light, lambda share: progress(share / 3))
        if len(self.frames) == 1:
            return single
        # Free its memory before the next solver is planned.
        del alone
        solver = self._plan_solver(chunk, light.shape)
        lights = self._lights(chunk.source, light, self._predicted(solver, chunk, single))
        return solver.apply(
            lights, prior=self.together.latent_prior, progress=lambda share: progress((1 + 2 * share) / 3)
        )

    def _predicted(
        self, solver: BurstQuadratic | RowBurst, chunk: Chunk, single: FloatImage
    ) -> Callable[[int], FloatImage]:
        """Return a function that predicts what a frame shows of a solution for the reference alone."""
        if isinstance(solver, BurstQuadratic):
            return partial(solver.blurred, single)
        # The blur of every row would be drawn once more, and gains 0.01 dB (tv, eight simulated bursts).
        return lambda n: TileBlur(_cut(self.banks[n], chunk), single.shape, threads=self.together.threads).forward(
            single
        )

    def _lights(self, rows: slice, light: FloatImage, predicted: Callable[[int], FloatImage]) -> Iterator[FloatImage]:
        """Yield the light of all frames at some rows of the reference, that of the reference first.

        Where another frame does not show the scene of the reference, its pixels are replaced by those that the solution
        of the reference alone predicts. So they neither help nor harm, and priors see whole pictures.
        """
        yield light
        for n, frame in enumerate(self.frames[1:], 1):
            shown, weights = frame.light(rows, self.together.threads)
            if weights.min() < 1:
                # predicted + weights (shown - predicted)
                blurred = predicted(n)
                shown -= blurred
                shown *= weights[..., None]
                shown += blurred
            yield shown

    def _plan_solver(self, chunk: Chunk, shape: tuple[int, int, int]) -> BurstQuadratic | RowBurst:
        """Plan the solver of all frames together for a chunk whose light has the given shape."""
        settings = self.together
        engine: dict[str, Any] = {name: getattr(settings, name) for name in ("nsr", "border", "planning", "threads")}
        if settings.mode != "rowwise":
            banks = [_cut(bank, chunk) for bank in self.banks]
            return BurstQuadratic(banks, self.shares, shape, wiener=settings.weight is None, **engine)
        rows = chunk.source
        paths = [frame.alignment.every_row(rows.start, rows.stop, self.banks[0].cols) for frame in self.frames]
        paths = [replace(path, rows=path.rows - chunk.source.start) for path in paths]
        return RowBurst(paths, self.shares, shape, solver=settings.solver, **engine)


def _cut(bank: PsfBank, chunk: Chunk) -> PsfBank:
    """Return the PSFs of a bank at the places of a chunk, counted from its first row."""
    first = int(np.searchsorted(bank.rows, chunk.bank.rows[0] + chunk.source.start - 0.5))
    part, paths = slice(first, first + len(chunk.bank.rows)), bank.displacements
    paths = None if paths is None else paths[part]
    return PsfBank(bank.kernels[part], chunk.bank.rows, chunk.bank.cols, paths, bank.softness)


def _banks(frames: Sequence[BurstFrame], rows: FloatArray, cols: FloatArray) -> list[PsfBank]:
    """Return the PSFs of the resampled frames on one grid."""
    return [PsfBank.from_paths(frame.alignment.paths(rows, cols)) for frame in frames]


def _largest(banks: Sequence[PsfBank]) -> tuple[int, int]:
    """Return the height and the width that hold every PSF."""
    tall, wide = (max(bank.size[axis] for bank in banks) for axis in (0, 1))
    return tall, wide


def _use(burst: _Burst, index: int, share: float, frame: ReadoutFrame) -> FrameUse:
    """Return what a frame contributed."""
    own = burst.frames[index]
    noise, blur = own.tuning.noise, own.tuning.radius
    if own.fit is None:
        weights = np.ones(own.grey.shape, dtype=np.float32)
        return FrameUse(share, 1.0, 1.0, 0.0, noise, blur, frame.back(weights))
    fit = own.fit
    shift = own.factor * float(np.sqrt(np.square(fit.shift).sum(axis=-1).mean()))
    return FrameUse(share, fit.support, fit.gain, shift, noise * fit.gain, blur, frame.back(own.shown_weights))
