"""Signals that end a process."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator

import pytest

from rsdeblur._util import interrupts

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")


@pytest.mark.parametrize("busy", [False, True], ids=["idle", "busy"])
@pytest.mark.parametrize("inside", [False, True], ids=["plain", "in a destructor"])
def test_an_interrupt_is_never_lost(
    inside: bool, busy: bool, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Python ignores what is raised in destructors; the interrupt comes once more."""
    start = threading.Thread.start

    def slowly(thread: threading.Thread) -> None:
        start(thread)
        time.sleep(3 * interrupts.RETRY)

    if busy:
        monkeypatch.setattr(threading.Thread, "start", slowly)

    class Dying:
        def __del__(self) -> None:
            signal.raise_signal(signal.SIGTERM)

    def work() -> None:
        with interrupts.raised():
            if inside:
                Dying()
            else:
                signal.raise_signal(signal.SIGTERM)
            # Ended by the second signal after RETRY.
            time.sleep(30)

    hook, by_keyboard = sys.unraisablehook, signal.getsignal(signal.SIGINT)
    try:
        with pytest.raises(interrupts.Interrupt) as caught:
            work()
    finally:
        # The first signal makes the process ignore all others.
        signal.signal(signal.SIGINT, by_keyboard)
    assert caught.value.number == signal.SIGTERM
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    assert sys.unraisablehook is hook
    assert capsys.readouterr().err == ""


def test_two_signals_at_once_are_one_interrupt(capsys: pytest.CaptureFixture[str]) -> None:
    """A service manager ends all processes of a command, while the command interrupts its workers."""
    both = {signal.SIGINT, signal.SIGTERM}

    def work() -> None:
        with interrupts.raised():
            signal.pthread_sigmask(signal.SIG_BLOCK, both)
            for number in both:
                signal.raise_signal(number)
            signal.pthread_sigmask(signal.SIG_UNBLOCK, both)

    with pytest.raises(interrupts.Interrupt):
        work()
    assert capsys.readouterr().err == ""


def test_a_compiler_is_not_interrupted() -> None:
    """An exception would leave its locks locked; the interrupt comes when it has ended."""
    numba: dict[str, object] = {"__name__": "numba.core", "signal": signal, "time": time, "done": False}
    exec(
        "def compile(wait):\n  signal.raise_signal(signal.SIGTERM)\n  time.sleep(wait)\n  global done\n  done = True",
        numba,
    )

    def work() -> None:
        with interrupts.raised():
            numba["compile"](3 * interrupts.RETRY)  # type: ignore[operator]
            time.sleep(30)

    by_keyboard = signal.getsignal(signal.SIGINT)
    with pytest.raises(interrupts.Interrupt):
        work()
    assert numba["done"]
    assert signal.getsignal(signal.SIGINT) is by_keyboard


class TestPostponed:
    """Signals wait, and none is lost; afterwards the handlers are as before."""

    @pytest.fixture(autouse=True)
    def unchanged(self) -> Iterator[None]:
        before = [signal.getsignal(number) for number in interrupts.ENDING]
        yield
        assert [signal.getsignal(number) for number in interrupts.ENDING] == before

    def test_an_interrupt_comes_at_the_end(self) -> None:
        done = False

        def work() -> None:
            nonlocal done
            with interrupts.Postponed():
                signal.raise_signal(signal.SIGINT)
                done = True

        with pytest.raises(KeyboardInterrupt):
            work()
        assert done

    def test_an_interrupt_comes_where_it_is_asked_for_and_spares_the_cleanup(self) -> None:
        clean = False

        def work() -> None:
            nonlocal clean
            with interrupts.Postponed() as signals:
                try:
                    signal.raise_signal(signal.SIGINT)
                    signals.deliver()
                    raise AssertionError("not interrupted")
                finally:
                    signal.raise_signal(signal.SIGINT)
                    clean = True

        with pytest.raises(KeyboardInterrupt):
            work()
        assert clean

    def test_further_signals_stay_ignored_after_the_first(self) -> None:
        def work() -> None:
            with interrupts.Postponed() as signals:
                signal.raise_signal(signal.SIGTERM)
                signals.deliver()

        with interrupts.raised():
            with pytest.raises(interrupts.Interrupt):
                work()
            signal.raise_signal(signal.SIGTERM)

    def test_handlers_that_do_not_raise_are_called_once_a_signal(self) -> None:
        calls: list[int] = []
        before = signal.signal(signal.SIGINT, lambda number, _: calls.append(number))
        with interrupts.Postponed() as signals, interrupts.Postponed():
            for _ in range(2):
                signal.raise_signal(signal.SIGINT)
                signals.deliver()
            signal.raise_signal(signal.SIGINT)
        signal.signal(signal.SIGINT, before)
        assert calls == 3 * [signal.SIGINT]

    def test_other_threads_have_no_signals(self) -> None:
        def work() -> None:
            with interrupts.Postponed() as signals:
                handlers.append(signal.getsignal(signal.SIGINT))
                signals.deliver()

        handlers: list[object] = []
        thread = threading.Thread(target=work)
        thread.start()
        thread.join()
        assert handlers == [signal.getsignal(signal.SIGINT)]
