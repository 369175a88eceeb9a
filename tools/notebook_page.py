"""Converts a notebook with its stored outputs to a page of the documentation site: `notebook_page`.

mkdocs-jupyter is not used: its pages load scripts from the network, and it needs nbconvert and a Jupyter kernel. Cells are not run.
"""

from __future__ import annotations

import base64
import html
import json
import re
from pathlib import Path
from typing import Any

_STYLE = re.compile(r"<style.*?</style>\n?", re.S)
_TABLE = re.compile(r"<table.*?</table>", re.S)


def notebook_page(path: Path) -> tuple[str, dict[str, bytes]]:
    """Return a notebook as Markdown, and its pictures: file name -> PNG. The Markdown shows pictures by these names.

    Raises ValueError if the notebook has an output that this module cannot convert, such as an exception.
    """
    cells = json.loads(path.read_text())["cells"]
    pictures: dict[str, bytes] = {}
    parts = []
    for cell in cells:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
        else:
            parts.append(f"```python\n{source}\n```")
            parts += [_output(output, path, pictures) for output in cell["outputs"]]
    return "\n\n".join(parts) + "\n", pictures


def _output(output: dict[str, Any], path: Path, pictures: dict[str, bytes]) -> str:
    """Return one output as Markdown. Add its picture to `pictures`."""
    data = output.get("data", {})
    if "image/png" in data:
        name = f"{path.stem}-{len(pictures) + 1}.png"
        pictures[name] = base64.b64decode("".join(data["image/png"]))
        return f"![Output of the cell above]({name})"
    if table := _TABLE.search(_STYLE.sub("", "".join(data.get("text/html", "")))):
        narrow = table[0].replace("<th>", '<th style="min-width: 0">')
        return narrow.replace('<table border="1" class="dataframe">', "<table>")
    text = data.get("text/plain", output.get("text"))
    if text is None:
        raise ValueError(
            f"{path}: got an output of type {output.get('output_type')}, expected a picture, a table or text"
        )
    return f"<pre>{html.escape(''.join(text))}</pre>"
