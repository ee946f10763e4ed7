"""A page that is closed takes its work with it: the folder is removed and what runs is ended, once its browser is gone for a while.

Streamlit forgets a session only when the next one comes, so the work of the last page of a day would lie there until the server ends.
"""

import threading
import time
import weakref
from collections.abc import Callable
from typing import TYPE_CHECKING


if TYPE_CHECKING:
    from .work import Work


GRACE = 120  # s without its browser (a reload, a lost connection): then a session cannot be taken up again
EVERY = 10.0  # s


class Watch:
    """Works by the sessions that they belong to; it keeps none of them alive."""

    def __init__(self, grace: float = GRACE) -> None:
        self.grace = grace
        self._lock = threading.Lock()
        self._works: dict[str, tuple[weakref.ref, float]] = {}  # and when its session was last there

    def add(self, session: str, work: "Work") -> None:
        with self._lock:
            self._works[session] = weakref.ref(work), time.monotonic()

    def look(self, there: Callable[[str], bool], now: float) -> None:
        """Close the works whose sessions have not been there for the time of grace."""
        with self._lock:
            works = dict(self._works)
        for session, (found, last) in works.items():
            work = found()
            if work is not None and there(session):
                with self._lock:
                    if self._works[session][0] is found:
                        self._works[session] = found, now
            elif work is None or now - last > self.grace:
                with self._lock:
                    if self._works[session][0] is found:
                        del self._works[session]
                if work is not None:
                    work.close()


_WATCH = Watch()
_started = threading.Lock()  # taken once, and for good


def close_with_session(work: "Work") -> None:
    """From here on the work ends with the session of the page that calls this; without a server nothing happens."""
    from streamlit import runtime
    from streamlit.runtime.scriptrunner import get_script_run_ctx

    context = get_script_run_ctx()
    if context is None or not runtime.exists():
        return
    _WATCH.add(context.session_id, work)
    if _started.acquire(blocking=False):
        threading.Thread(target=_look_forever, name="closed pages", daemon=True).start()


def _look_forever() -> None:
    from streamlit import runtime

    while runtime.exists():
        _WATCH.look(runtime.get_instance().is_active_session, time.monotonic())
        time.sleep(EVERY)
