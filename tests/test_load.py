"""Solvers in many threads and in forked and spawned processes give the bits of one thread and never hang."""

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from multiprocessing import get_context
from typing import Any, Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from rsdeblur import Camera, Deconvolver, Exposure, InputError, deblur, hand_shake, psfs
from rsdeblur.deconv import DerivativePrior, PlugAndPlayPrior, RowBlur, RowDeconvolver, TileQuadratic
from rsdeblur.motion import BlurPaths, Capture

Image = NDArray[np.float32]
Apply = Callable[..., Image]
THREADS = 8
HEIGHT, WIDTH = 48, 64
RECORDING = hand_shake(0.3, seed=1), Camera(WIDTH, HEIGHT, 60.0, readout_time=0.03), Exposure(0.1, 0.03)
PICTURE = np.full((HEIGHT, WIDTH, 3), 0.5, np.float32)

KINDS = "global", "banded", "banded and strips", "rowwise", "total variation", "RowBlur"


def noise(count: int) -> Image:
    return np.random.default_rng(0).random((count, HEIGHT, WIDTH, 3), dtype=np.float32)


@cache
def solvers(threads: int) -> dict[str, Apply]:
    """Return a solver of each kind, planned once, as a function of a picture and `out`."""
    shape = (HEIGHT, WIDTH, 3)
    tiles = {"global": (1, 1), "banded": (4, 1), "banded and strips": (4, 3)}
    banks = {name: psfs(*RECORDING, bands=bands, strips=strips) for name, (bands, strips) in tiles.items()}
    paths = BlurPaths.every_row(Capture.from_log(*RECORDING), banks["banded and strips"].cols)
    blur = RowBlur(paths, WIDTH, channels=3, threads=threads)
    quadratic = TileQuadratic(banks["banded and strips"], shape, threads=threads)

    def total_variation(picture: Image, out: Image | None = None) -> Image:
        return quadratic.apply(picture, out, prior=DerivativePrior("tv", 1e-3))

    def row_blur(picture: Image, out: Image | None = None) -> Image:
        return np.positive(blur.forward(blur.adjoint(picture)), out=out)

    by_name: dict[str, Apply] = {name: Deconvolver(bank, shape, threads=threads).apply for name, bank in banks.items()}
    rowwise = RowDeconvolver(paths, shape, threads=threads).apply
    return by_name | {"rowwise": rowwise, "total variation": total_variation, "RowBlur": row_blur}


def used() -> dict[str, Apply]:
    """Return the solvers, and `deblur`."""
    return solvers(2) | {f"deblur, {mode}": partial(_deblur, mode=mode) for mode in ("banded", "rowwise")}


def _deblur(picture: Image, *, mode: Literal["banded", "rowwise"]) -> Image:
    return deblur(picture, *RECORDING, mode=mode, prior="wiener").image


def _answer(queue: Any, inherited: dict[str, Apply] | None, picture: Image) -> None:
    mine = solvers(2) if inherited is None else inherited
    queue.put({name: apply(picture).tobytes() for name, apply in mine.items()})


@pytest.mark.parametrize("kind", KINDS)
def test_threads_that_share_a_solver_get_the_bits_of_one(kind: str) -> None:
    apply, pictures, start = solvers(2)[kind], noise(THREADS), threading.Barrier(THREADS)
    expected = [apply(picture) for picture in pictures]

    def work(thread: int) -> None:
        start.wait()
        for i in range(3):
            which = (3 * thread + i) % len(pictures)
            # Write to a new array, to a given array, and in place.
            picture = pictures[which].copy()
            out = (None, np.empty_like(picture), picture)[i % 3]
            np.testing.assert_array_equal(apply(picture, out), expected[which])

    with ThreadPoolExecutor(THREADS) as pool:
        list(pool.map(work, range(THREADS)))


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_other_processes_get_the_same_bits(method: str) -> None:
    """A forked process inherits the solvers while another thread of the parent uses them."""
    picture, context = noise(1)[0], get_context(method)
    mine = used() if method == "fork" else solvers(2)
    expected = {name: apply(picture).tobytes() for name, apply in mine.items()}
    done, working = threading.Event(), mine["banded"]
    other = threading.Thread(target=lambda: [working(picture) for _ in iter(done.is_set, True)])
    other.start()
    queue = context.Queue()
    arguments = (queue, mine if method == "fork" else None, picture)
    process = context.Process(target=_answer, args=arguments)  # type: ignore[attr-defined]  # of both contexts
    try:
        process.start()
        assert queue.get(timeout=60) == expected
        process.join()
        assert process.exitcode == 0
    finally:
        process.kill()
        done.set()
        other.join()


def test_a_function_that_a_solver_calls_may_not_use_it() -> None:
    """It would spoil the solver's buffers, or wait for itself."""
    bank, prior = psfs(*RECORDING, bands=2, strips=1), DerivativePrior("tv", 1e-3)
    tiles = TileQuadratic(bank, PICTURE.shape)
    rows = RowDeconvolver(BlurPaths.every_row(Capture.from_log(*RECORDING), [20.0]), PICTURE.shape)
    wiener = Deconvolver(bank, PICTURE.shape)
    calls: list[Callable[[Callable[..., Any]], Any]] = [
        lambda again: tiles.apply(PICTURE, prior=prior, progress=again),
        lambda again: tiles.apply(PICTURE, prior=PlugAndPlayPrior(lambda image, sigma: again() or image, 0.01)),
        lambda again: rows.apply(PICTURE, progress=again),
        lambda again: wiener.apply(PICTURE, progress=again),
    ]
    for call in calls:
        with pytest.raises(InputError, match="the solver is at work on a picture"):
            call(lambda *_: call(lambda *_: None))  # noqa: B023
        call(lambda *_: None)  # The refusal leaves the solver as it was.
