"""A program that ends with the one that started it, however that ended: `python -m thermohyd.identify.app.child MODULE ARGUMENT ...`.

Its standard input is a pipe that the starter holds open and writes nothing into. The system closes it when the starter is gone, after
`kill -9` too: of all signs that a parent has ended, this one is there on every system and asks for no second look.
"""

import os
import runpy
import signal
import sys
import threading
import time


TERMINATED = 143
PATIENCE = 30.0  # s: what the module does at its end, such as ending what it started itself


def main() -> None:
    """Run the module as `python -m` would."""
    pipe = os.dup(0)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)  # the module finds nothing to read
    os.close(nothing)
    threading.Thread(target=_end_with_starter, args=(pipe,), name="starter", daemon=True).start()
    sys.argv = sys.argv[1:]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)


def _end_with_starter(pipe: int) -> None:
    while os.read(pipe, 1):
        pass
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(PATIENCE)
    os._exit(TERMINATED)


if __name__ == "__main__":
    main()
