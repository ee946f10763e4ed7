"""`thermohyd app`: what it needs, where it serves, what no configuration file changes, and that it leaves nothing behind."""

import os
import socket
import urllib.error
import urllib.request
from importlib.util import find_spec

import pytest
from helpers.served_app import served_app
from typer.testing import CliRunner

from thermohyd.identify.cli import app_command
from thermohyd.identify.cli.commands import app


def test_without_streamlit_it_says_what_to_install(monkeypatch):
    there = find_spec
    monkeypatch.setattr(app_command, "find_spec", lambda name: None if name == "streamlit" else there(name))
    ran = CliRunner().invoke(app, ["app"])
    assert ran.exit_code == 2
    assert ran.output == (
        "thermohyd: the page needs Streamlit: pip install -c constraints.txt '.[app]' in the source folder of thermohyd\n"
    )


def test_nothing_is_reported_and_only_this_machine_is_served():
    settings = app_command._settings(app_command.LOCAL, 8501, browser=False)
    for said in (
        "--server.address=127.0.0.1", "--server.enableXsrfProtection=true", "--server.enableCORS=true",
        "--server.enableAgentApi=false",
        "--client.allowedOrigins=http://127.0.0.1:8501", "--server.corsAllowedOrigins=http://127.0.0.1:8501",
        "--browser.gatherUsageStats=false", "--server.allowedHosts=localhost",
        "--server.showEmailPrompt=false", "--client.showErrorDetails=none", "--server.headless=true",
    ):  # fmt: skip
        assert said in settings
    assert "--server.allowedHosts=localhost" not in app_command._settings("0.0.0.0", 8501, browser=False)


def test_a_port_in_use():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        ran = CliRunner().invoke(app, ["app", "--address", "127.0.0.1", "--port", str(port)])
    assert ran.exit_code == 2
    assert f"--port {port} cannot be served (Address already in use); name another" in ran.output


# What a folder that somebody sent may hold, where the program is started in it.
HOSTILE = """
[server]
enableXsrfProtection = false
enableCORS = false
enableAgentApi = true
baseUrlPath = "elsewhere"
corsAllowedOrigins = ["http://evil.test"]
unheardOf = 1
[client]
allowedOrigins = ["http://evil.test"]
"""


def status(url: str, **headers: str) -> int:
    """Of an upload without the token of the page."""
    try:
        return urllib.request.urlopen(urllib.request.Request(url, b"x", headers, method="PUT"), timeout=30).status
    except urllib.error.HTTPError as error:
        with error:
            return error.code


@pytest.mark.skipif(os.name != "posix", reason="sends POSIX signals")
def test_it_serves_until_ctrl_c_and_heeds_no_settings_of_a_folder(tmp_path, monkeypatch):
    folder = tmp_path / "record" / ".streamlit"
    folder.mkdir(parents=True)
    (folder / "config.toml").write_text(HOSTILE)
    monkeypatch.setenv("STREAMLIT_SERVER_ENABLE_CORS", "false")
    with served_app(tmp_path, where=folder.parent) as served:
        assert served.answers
        assert status(f"{served.address}/_stcore/upload_file/a/b") == 403
        with urllib.request.urlopen(f"{served.address}/_stcore/host-config", timeout=30) as answer:
            assert "evil" not in answer.read().decode()
        served.interrupt()
    assert served.status == 0, served.errors
    assert served.out.startswith(f"The page: {served.address} (Ctrl-C ends it)\n")
    assert "Traceback" not in served.errors
    assert "unheardOf" not in served.errors
    assert not served.answers


@pytest.mark.skipif(os.name != "posix", reason="sends POSIX signals")
def test_killed_it_takes_its_server_along(tmp_path):
    with served_app(tmp_path) as served:
        assert served.answers
        served.kill()
        assert not served.answers
