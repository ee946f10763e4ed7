"""--quiet and --verbose, which every command takes: how much is said beside results, warnings and failures.

The group of commands that takes them also notes what was typed, which reports repeat, and shows help texts as they are written.
"""

from contextvars import ContextVar
from enum import Enum
from typing import Annotated, Any

import typer
from rich.markup import escape
from typer.core import TyperGroup
from typer.main import get_command

from thermohyd.identify.typed_command import typed


class Loudness(Enum):
    """QUIET: warnings and failures only. VERBOSE: every step of the work, with the seconds since its start."""

    QUIET = "quiet"
    USUAL = "usual"
    VERBOSE = "verbose"


_LOUDNESS: ContextVar[Loudness] = ContextVar("loudness", default=Loudness.USUAL)


def loudness() -> Loudness:
    """What the command that runs was asked for."""
    return _LOUDNESS.get()


class Commands(TyperGroup):
    """The program's commands, each with --quiet and --verbose."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        _as_written(self)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        command = super().get_command(ctx, cmd_name)
        if (
            command is not None
            and not isinstance(command, TyperGroup)
            and not any(param.name == "quiet" for param in command.params)
        ):
            command.params += _options()
            _as_written(command)
        return command

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> Any:
        given = tuple(args)  # parsing takes them off the list
        context = super().make_context(info_name, args, parent, **extra)
        if parent is None:
            context.meta[__name__] = given
        return context

    def invoke(self, ctx: Any) -> Any:
        if ctx.parent is not None:
            return super().invoke(ctx)
        _LOUDNESS.set(Loudness.USUAL)  # several commands may run in one process
        with typed(ctx.meta.get(__name__, ())):
            return super().invoke(ctx)


def _as_written(command: Any) -> None:
    """Rich would take the [start] of a help text for a style, and show nothing of it."""
    for part in (command, *command.params):
        if part.help:
            part.help = escape(part.help)


def _choose(chosen: Loudness, given: bool) -> bool:
    if given:
        if loudness() not in (Loudness.USUAL, chosen):
            raise typer.BadParameter("contradicts --quiet or --verbose beside it: keep one of them")
        _LOUDNESS.set(chosen)
    return given


def _options() -> list[Any]:
    """The two options, as typer makes them of a command that has nothing else."""
    made = typer.Typer(add_completion=False)

    @made.command()
    def _(
        quiet: Annotated[
            bool,
            typer.Option(
                "--quiet",
                "-q",
                callback=lambda given: _choose(Loudness.QUIET, given),
                help="Say nothing but warnings and failures; files and --json as ever.",
            ),
        ] = False,
        verbose: Annotated[
            bool,
            typer.Option(
                "--verbose",
                "-v",
                callback=lambda given: _choose(Loudness.VERBOSE, given),
                help="Say every step on stderr, with the seconds since the start.",
            ),
        ] = False,
    ) -> None: ...

    options = [param for param in get_command(made).params if param.name in ("quiet", "verbose")]
    for option in options:
        option.expose_value = False  # the commands themselves know nothing of them
    return options
