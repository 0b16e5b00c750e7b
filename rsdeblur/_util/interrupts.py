"""Signals that end a process: Ctrl-C, `kill` and `docker stop`, and a terminal that closes.

All of them raise KeyboardInterrupt, so that unfinished files are removed on the way out.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

# Windows has no SIGHUP.
ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
# Time until an interrupt that was lost is delivered again, s.
RETRY = 0.02


class Interrupt(KeyboardInterrupt):
    """An interrupt by a signal other than Ctrl-C.

    Parameters
    ----------
    number : int
        The signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number


def interrupt_once(number: int, _: object = None) -> NoReturn:
    """Signal handler: raise `Interrupt`, and ignore further signals, which would stop the cleanup."""
    for each in ENDING:
        signal.signal(each, signal.SIG_IGN)
    sys.unraisablehook = _deliver_again
    raise Interrupt(number)


def _deliver_again(lost: sys.UnraisableHookArgs) -> None:
    """Repeat a signal whose handler raised where Python only prints errors: in destructors and callbacks."""
    if not isinstance(lost.exc_value, Interrupt):
        sys.__unraisablehook__(lost)
        return
    number, armed = lost.exc_value.number, threading.Event()

    def deliver() -> None:
        armed.wait()
        time.sleep(RETRY)
        os.kill(os.getpid(), number)

    # To start a thread may take longer than RETRY on a busy machine, and here another exception would be lost. So
    # signals are ignored until the thread runs, and the time counts from then on.
    threading.Thread(target=deliver, daemon=True).start()
    signal.signal(number, interrupt_once)
    armed.set()


@contextmanager
def raised() -> Iterator[None]:
    """Make SIGTERM and SIGHUP raise `Interrupt` while the block runs, unless the caller ignores or handles them."""
    taken = [number for number in ENDING if signal.getsignal(number) is signal.SIG_DFL]
    with _handlers(dict.fromkeys(taken, interrupt_once)):
        yield


@contextmanager
def ignored() -> Iterator[None]:
    """Ignore all of these signals; processes started inside ignore them until they set their own handlers."""
    with _handlers(dict.fromkeys(ENDING, signal.SIG_IGN)):
        yield


@contextmanager
def _handlers(handlers: dict[int, Any]) -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    hook = sys.unraisablehook
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        sys.unraisablehook = hook
        for number, handler in before.items():
            signal.signal(number, handler)
