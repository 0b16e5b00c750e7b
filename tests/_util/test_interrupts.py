"""Signals that end a process."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time

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
