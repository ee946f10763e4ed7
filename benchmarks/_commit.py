"""Of which commit a figure is."""

import subprocess
from pathlib import Path


ROOT = Path(__file__).parents[1]


def commit(*looked_at: str) -> str:
    """The commit, and whether something that is not in it changes it. looked_at: arguments of git status."""
    git = lambda *words: subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False).stdout
    changed = " with changes" if git("status", "--porcelain", *looked_at).strip() else ""
    return f"{git('rev-parse', '--short', 'HEAD').strip() or 'unknown'}{changed}"
