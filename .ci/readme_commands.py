"""Print the shell commands of a page: `sh` blocks, and the `$` lines of `console` blocks."""

from __future__ import annotations

import re
import sys
from pathlib import Path

page = Path(sys.argv[1]).read_text(encoding="utf-8")
for language, block in re.findall(r"^```(sh|console)\n(.*?)^```", page, re.DOTALL | re.MULTILINE):
    for line in block.splitlines():
        if language == "sh":
            print(line)
        elif line.startswith("$ "):
            print(line.removeprefix("$ "))
