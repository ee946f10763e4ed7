"""Which records go to a worker together: of one shape, so that its process compiles once for all of them. Host only."""

from collections import defaultdict, deque
from collections.abc import Iterable

from .identity import Found


MOST = 16  # records of a chunk: what a worker that dies takes with it is at most computed again by name, not lost
PER_WORKER = 4  # chunks that each worker should get at least, so that none waits long for the last


def in_chunks(records: Iterable[Found], workers: int) -> list[list[Found]]:
    """Records of one shape in chunks, the shape with the most records first."""
    by_shape: dict[tuple[tuple[str, int], ...], list[Found]] = defaultdict(list)
    for found in records:
        by_shape[found.shape].append(found)
    count = sum(map(len, by_shape.values()))
    size = max(1, min(MOST, -(-count // (PER_WORKER * max(workers, 1)))))
    ordered = sorted(by_shape.values(), key=len, reverse=True)
    return [of_shape[i : i + size] for of_shape in ordered for i in range(0, len(of_shape), size)]


class Deal:
    """Chunks still to be given out. A worker gets the shape that it had last, then one that no other worker is at."""

    def __init__(self, chunks: Iterable[list[Found]]) -> None:
        self._left: dict[tuple[tuple[str, int], ...], deque[list[Found]]] = defaultdict(deque)
        for chunk in chunks:
            self._left[chunk[0].shape].append(chunk)
        self._last: dict[str, tuple[tuple[str, int], ...]] = {}

    def __len__(self) -> int:
        return sum(map(len, self._left.values()))

    def records(self) -> list[Found]:
        """All that nobody was given."""
        return [found for chunks in self._left.values() for chunk in chunks for found in chunk]

    def next_for(self, worker: str) -> list[Found] | None:
        """None where nothing is left."""
        if not self._left:
            return None
        shape = self._last.get(worker)
        if shape not in self._left:
            taken = set(self._last.values())
            free = [s for s in self._left if s not in taken]
            shape = max(free or self._left, key=lambda s: len(self._left[s]))
        self._last[worker] = shape
        chunk = self._left[shape].popleft()
        if not self._left[shape]:
            del self._left[shape]
        return chunk
