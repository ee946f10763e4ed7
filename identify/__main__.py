"""Entry point of the `thermohyd` command, and of `python -m thermohyd.identify`: signals first, then whatever takes time."""

from .interruption import done, leave_at_once_on_signals


def main() -> None:
    """Run the command that the arguments name."""
    leave_at_once_on_signals()
    try:
        from thermohyd.identify.cli.commands import main as run

        run()
    finally:
        done()


if __name__ == "__main__":
    main()
