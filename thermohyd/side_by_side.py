"""Do pieces of work that know nothing of one another at the same time: refits of several candidates, each in a thread.

What they give is what they would give one after another, to the last bit, and in the same order: only the time is another. XLA's programs
and NumPy's larger steps run beside one another; what is Python's own takes turns.
"""

import os
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from typing import Any


# Beyond this many Python's own turns are what is left, and each refit under way holds its columns. Never measured on more than two cores.
MOST_THREADS = 8

_within = threading.local()


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def threads() -> int:
    """How many pieces of work at a time: one per core, or what NPROC says, by which XLA goes too."""
    told = os.environ.get("NPROC", "")
    return max(1, min(int(told) if told.isdigit() else cores(), MOST_THREADS))


def each[Item, Answer](ask: Callable[[Item], Answer], items: Iterable[Item]) -> list[Answer]:
    """`[ask(item) for item in items]`, several at a time; within such work, and of one item alone, one after another.

    An error of any is raised, the first by their order; what has not begun by then is not begun.
    """
    given = list(items)
    many = min(threads(), len(given))
    if many < 2 or getattr(_within, "others", False):
        return [ask(item) for item in given]
    import jax  # not above: what has nothing to do at the same time does not wait for it

    of_this_thread = lambda: tuple(getattr(jax.config, name) for name in ("jax_enable_x64", "jax_default_device"))
    double, device = of_this_thread()

    def asked(item: Item) -> Answer:
        _within.others = True  # the thread lives no longer than this call
        with ExitStack() as kept:  # settings that the caller made for its own thread alone
            if of_this_thread() != (double, device):
                kept.enter_context(_with_double(double))
                kept.enter_context(jax.default_device(device))
            return ask(item)

    with ThreadPoolExecutor(many, thread_name_prefix="refit") as pool:
        return list(pool.map(asked, given))


def by_name[Answer](ask: Callable[[str], Answer], names: Iterable[str]) -> dict[str, Answer]:
    """{name: ask(name)}, several at a time."""
    given = list(names)
    return dict(zip(given, each(ask, given), strict=True))


class LastAsked(threading.local):
    """What each thread asked for last, and what was found: asked again for the same it is not worked out again."""

    known: tuple[Any, Any] | None = None

    def of(self, key: Any, work_out: Callable[[], Any]) -> Any:
        if self.known is None or self.known[0] != key:
            self.known = key, work_out()
        return self.known[1]


def _with_double(double: bool) -> Any:
    """A setting of JAX for a thread; releases before 0.8 have it elsewhere."""
    import jax
    from jax import experimental

    name = "enable_x64"
    return getattr(jax if hasattr(jax, name) else experimental, name)(double)
