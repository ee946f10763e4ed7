"""Run as a program: the blocks of pages in the printed order, in one fresh session, in the folder where it is started.

python -P page_session.py PAGE ... prints JSON: what each top-level statement of a Python block printed, with the comment
behind it, and what each of the first shell block's commands ended with. Programs are compiled quickly rather than well, the
diagnosis searches a short library and the sensitivity study takes few samples: no figure on the page depends on these.
"""

import ast
import io
import json
import re
import shlex
import sys
import tokenize
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any
from unittest.mock import patch


PROGRAM = ".venv/bin/thermohyd "
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?!\w)")


def agrees(printed: str, comment: str) -> bool:
    """Whether the comment quotes what was printed, or its numbers are those printed, in order, to the digits it shows."""
    if printed.strip() in comment:
        return True
    said, shown = (NUMBER.findall(text) for text in (comment, printed))
    return len(said) == len(shown) > 0 and all(
        f"{float(b):.{digits(a)}f}" == a.lstrip("+") for a, b in zip(said, shown, strict=True)
    )


def digits(number: str) -> int:
    return len(number.partition(".")[2])


def python_blocks(page: str) -> list[str]:
    return re.findall(r"^```python\n(.*?)^```", page, flags=re.DOTALL | re.MULTILINE)


def commands(page: str) -> list[list[str]]:
    """Arguments of every `thermohyd` command in the page's shell blocks."""
    lines = [line.strip() for line in page.splitlines() if line.startswith(f"    {PROGRAM}")]
    return [shlex.split(line.removeprefix(PROGRAM), comments=True) for line in lines]


def comments(block: str) -> dict[int, str]:
    """{line: the comment at its end}"""
    tokens = tokenize.generate_tokens(io.StringIO(block).readline)
    return {token.start[0]: token.string.lstrip("# ") for token in tokens if token.type == tokenize.COMMENT}


def run_block(block: str, session: dict[str, Any]) -> list[dict[str, str]]:
    """Each statement's code, what it printed, and the comment at its end."""
    said, done = comments(block), []
    for statement in ast.parse(block).body:
        with redirect_stdout(io.StringIO()) as out:
            exec(compile(ast.Module([statement], []), "page", "exec"), session)
        code = ast.get_source_segment(block, statement) or ""
        done.append({"code": code, "printed": out.getvalue(), "comment": said.get(statement.end_lineno or 0, "")})
    return done


def run_command(arguments: list[str]) -> int:
    from typer.testing import CliRunner

    from thermohyd.identify.cli import jax_setup
    from thermohyd.identify.cli.commands import app

    with patch.object(jax_setup, "set_up_jax", lambda: None):  # the session has set its own
        ran = CliRunner().invoke(app, arguments)
    print(ran.output, file=sys.stderr)
    return ran.exit_code


def make_small() -> None:
    """What only takes time is made short; after the first block, so that it starts as a reader's session does."""
    import jax

    from helpers.small_diagnosis import LIBRARY
    from thermohyd.identify.diagnosis import case
    from thermohyd.identify.fitting.library import Library
    from thermohyd.identify.sensitivity import curves as row_slopes, static_figures as outputs, study

    jax.config.update("jax_disable_most_optimizations", True)
    patch.object(case, "library_for", lambda tests: Library(LIBRARY, {})).start()
    patch.object(study, "EVALUATIONS", 1024).start()
    patch.object(study, "DERIVATIVE_SAMPLES", 16).start()
    patch.object(study, "POSITIONS", 31).start()
    patch.object(study, "POSTERIOR_EVALUATIONS", 512).start()
    patch.object(row_slopes, "ROWS", 128).start()
    patch.object(outputs, "CHUNK", 128).start()


def main(page: str) -> dict[str, Any]:
    new, *further = [line for line in commands(page) if line[0] in ("new", "fit", "simulate")]
    ended = {" ".join(new): run_command(new)}
    session: dict[str, Any] = {"__name__": "__main__"}
    first, *others = python_blocks(page)
    blocks = [run_block(first, session)]
    make_small()
    blocks += [run_block(block, session) for block in others]
    ended |= {" ".join(line): run_command(line) for line in further}
    return {"blocks": blocks, "commands": ended, "files": sorted(str(p) for p in Path().rglob("*") if p.is_file())}


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))
    print(json.dumps(main("\n".join(Path(page).read_text(encoding="utf-8") for page in sys.argv[1:]))))
