"""`thermohyd app`: serve the page to drop a folder on. Streamlit runs in a process of its own, and nothing here imports it."""

import os
import socket
import subprocess
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from thermohyd.identify.optional_parts import PARTS, install

from .process import fail, plain_failures


LOCAL = "127.0.0.1"  # a name could lead to another user's page on the same port
THIS_MACHINE = (LOCAL, "localhost", "::1")
FIRST_PORT, PORTS = 8501, 100
LARGEST_UPLOAD = 400  # MB of one file: what the reader takes of a CSV


def app_command(
    port: Annotated[
        int | None,
        typer.Option(
            "--port", min=1, max=65535, help="Of the page.", show_default=f"the first free one from {FIRST_PORT} on"
        ),
    ] = None,
    address: Annotated[
        str,
        typer.Option(
            "--address", metavar="HOST", help="Where the page is served; any other can be reached from outside."
        ),
    ] = LOCAL,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in a browser.")] = True,
) -> None:
    """Serve a page to drop a record's folder on: see its columns, map headers by clicking, fit or diagnose, look at the report.

    Needs Streamlit: pip install -c constraints.txt '.[app]' in the source folder of thermohyd. Files stay on this machine. Ctrl-C ends it.
    """
    with plain_failures():
        from thermohyd.identify.app.command_run import CHILD
        from thermohyd.identify.bench.errors import BenchInputError
        from thermohyd.identify.interruption import first_interrupt_asks, when_interrupted

        if any(find_spec(name) is None for name in PARTS["app"]):
            raise BenchInputError(f"the page needs Streamlit: {install('app')}")
        chosen = _free_port(address, port)
        command = [*CHILD, "streamlit", "run", str(_script()), *_settings(address, chosen, browser)]
        typer.echo(f"The page: http://{_shown(address)}:{chosen} (Ctrl-C ends it)")
        if address not in THIS_MACHINE:
            typer.echo(
                f"thermohyd: warning: whoever reaches {address} can use the page, and nobody is asked for a password",
                err=True,
            )
        served = subprocess.Popen(command, stdin=subprocess.PIPE, cwd=_no_settings(), env=_environment())
        asked: list[bool] = []

        def end() -> None:
            asked.append(True)
            served.terminate()

        # Ctrl-C is how a page ends, no interruption: the server removes what was dropped, then all is well.
        with first_interrupt_asks(end), when_interrupted(end):
            status = served.wait()
        served.communicate()  # closes the pipe
        if status and not asked:
            fail(f"the server of the page ended with status {status}")


def _script() -> Path:
    from thermohyd.identify import app

    return Path(str(app.__file__)).parent / "served.py"


def _no_settings() -> Path:
    """Where the server runs: Streamlit takes settings, secrets and pages from a folder .streamlit where it is started, and that folder
    may hold what somebody sent."""
    return _script().parent


def _environment() -> dict[str, str]:
    """Of the server: without Streamlit's own variables."""
    return {name: value for name, value in os.environ.items() if not name.startswith("STREAMLIT_")}


def _settings(address: str, port: int, browser: bool) -> list[str]:
    """Options of Streamlit: what is said here no configuration file can change. Each that opens the server is among them, also where it
    says what Streamlit does anyway."""
    from thermohyd.identify.app.closing import GRACE

    page = f"http://{_shown(address)}:{port}"
    said: dict[str, object] = {
        "server.address": address,
        "server.port": port,
        "server.enableXsrfProtection": "true",
        "server.enableCORS": "true",
        "server.corsAllowedOrigins": page,
        "client.allowedOrigins": page,  # who may put the page into a frame and talk to it: else all of streamlit.app
        "server.enableAgentApi": "false",
        "server.baseUrlPath": "",
        "server.customComponentBaseUrlPath": "",
        "server.scriptHealthCheckEnabled": "false",
        "server.runOnSave": "false",
        "server.sslCertFile": "",
        "server.sslKeyFile": "",
        "server.headless": str(not browser).lower(),
        "server.showEmailPrompt": "false",
        "server.maxUploadSize": LARGEST_UPLOAD,
        "server.disconnectedSessionTTL": GRACE,
        "server.fileWatcherType": "none",
        "server.enableStaticServing": "false",
        "browser.gatherUsageStats": "false",
        "client.toolbarMode": "minimal",
        "client.showErrorDetails": "none",
        "client.showErrorLinks": "false",
        "theme.light.primaryColor": "#1f5fa8",  # the accents of the reports
        "theme.dark.primaryColor": "#4a90d9",
        "global.developmentMode": "false",
        "logger.hideWelcomeMessage": "true",
    }
    options = [f"--{key}={value}" for key, value in said.items()]
    if address in THIS_MACHINE:  # a page elsewhere whose name is made to lead here must not reach it
        options += [f"--server.allowedHosts={name}" for name in THIS_MACHINE]
    return options


def _shown(address: str) -> str:
    return f"[{address}]" if ":" in address else address


def _free_port(address: str, port: int | None) -> int:
    """The port asked for, or the first that nobody uses. Raises BenchInputError."""
    from thermohyd.identify.bench.errors import BenchInputError

    reason = ""
    for chosen in range(FIRST_PORT, FIRST_PORT + PORTS) if port is None else (port,):
        try:
            family, kind, protocol, _, place = socket.getaddrinfo(address, chosen, type=socket.SOCK_STREAM)[0]
            with socket.socket(family, kind, protocol) as one:
                one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                one.bind(place)
            return chosen
        except (OSError, UnicodeError) as error:
            reason = getattr(error, "strerror", None) or str(error)
    asked = "" if port is None else f", --port {port}"
    raise BenchInputError(f"--address {address}{asked} cannot be served ({reason}); name another")
