"""The page of the public API is what the docstrings say now, and every public name has one."""

import json
import subprocess
import sys
from pathlib import Path


ROOT = Path(__file__).parents[1]
ASKED = "import json, sys; sys.path.insert(0, sys.argv[1]); import api_page; print(json.dumps([api_page.page(), api_page.silent()]))"


def test_the_page_is_current_and_every_name_says_what_it_is(tmp_path):
    """In a process of its own, where no test's type checks wrap the functions."""
    ran = subprocess.run(
        [sys.executable, "-P", "-c", ASKED, str(ROOT / "tools")],
        capture_output=True,
        text=True,
        check=True,
        cwd=tmp_path,
    )
    page, silent = json.loads(ran.stdout)
    assert silent == []
    assert page == (ROOT / "docs" / "api.md").read_text(encoding="utf-8"), "make api writes it"
