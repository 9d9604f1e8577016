"""Card of a dataset: README.md with statistics and a picture."""

from __future__ import annotations

import io
import json
import platform
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from pepper_kin import __version__
from pepper_kin.datasets.columns import Column
from pepper_kin.datasets.store import Store
from pepper_kin.file_access.picture import new_figure

if TYPE_CHECKING:
    from pepper_kin.datasets.dataset import Dataset

CARD, STATISTICS, PICTURE = "README.md", "statistics.json", "picture.png"
_SHOWN = 2000  # maximum number of rows in the picture, from the first on
_LONG = 16  # maximum size of an item whose ranges the card lists

_TEXT = """\
---
license: {license}
tags: [robotics, pepper, pepper_kin]
---

# {name}

{rows} rows of kind `{kind}`, made by pepper_kin {version}; {bytes:.1f} MB in {shards} files of Parquet.

![The rows]({picture})

| ended | rows |
|---|---|
{statuses}

| column | type | shape | unit | range |
|---|---|---|---|---|
{columns}

Columns with T in their shape have an item for each frame; a row of them is a group of its file.
`statistics.json` has count, min, max, mean and std of all numbers, `manifest.json` the SHA-256 of all files.

```python
from pepper_kin import datasets

rows = datasets.open(".")
rows[0], rows.statistics
```

- Job: `job.yaml`, SHA-256 `{hash}`; seed {seed}. `pepper-kin dataset check .` recomputes a sample of rows.
- Versions: pepper_kin {version}, pyarrow {pyarrow}, NumPy {numpy}, Python {python}, {machine}.
- License: {license}
"""


def write_card(store: Store, dataset: Dataset) -> None:
    """Write statistics, picture and card of a dataset.

    Raises:
        MissingDependencyError: if matplotlib is not installed.
        FileFormatError: if a file cannot be written.
    """
    job, statistics = dataset.job, dataset.statistics
    store.write_text(STATISTICS, json.dumps(statistics, indent=1) + "\n")
    with store.write(PICTURE) as file:
        file.write(picture_of(dataset))
    text = _TEXT.format(
        name=job.name, license=job.license, kind=job.kind, rows=len(dataset), shards=len(dataset.shards),
        bytes=sum(shard["bytes"] for shard in dataset.shards) / 1e6, picture=PICTURE, hash=job.hash,
        statuses="\n".join(f"| {status} | {count} |" for status, count in dataset.statuses.items()),
        columns="\n".join(_line(column, statistics.get(column.name)) for column in dataset.columns),
        seed=job.seed, version=__version__, pyarrow=pa.__version__, numpy=np.__version__,
        python=platform.python_version(), machine=platform.machine(),
    )  # fmt: skip
    store.write_text(CARD, text)


def _line(column: Column, statistics: dict[str, Any] | None) -> str:
    """Return the line of a column for the card."""
    shape = (*(("T",) if column.frames else ()), *column.shape)
    known = [x for x in (statistics or {}).get("min", []) if x is not None]
    spread = ""
    if known:
        high = [x for x in statistics["max"] if x is not None]  # type: ignore[index]
        spread = f"{min(known):.4g} to {max(high):.4g}"
    size = " x ".join(map(str, shape))
    return f"| `{column.name}` | {column.dtype} | {size} | {column.unit} | {spread} |"


def picture_of(dataset: Dataset) -> bytes:
    """Return a picture of the first rows as PNG: goals from above and from the side, colored by status.

    If rows have no goals, the first column of numbers is drawn over time instead.

    Raises:
        MissingDependencyError: if matplotlib is not installed.
    """
    figure = new_figure("the picture of a dataset", figsize=(9, 3.4))
    axes = figure.subplots(1, 3)
    names = {column.name: column for column in dataset.columns}
    rows = min(_SHOWN, len(dataset))
    if "target" in names:
        targets, solved = np.empty((rows, 3)), np.empty(rows, bool)
        begin = 0
        for table in dataset.batches(["target", "status"]):
            part = table.slice(0, rows - begin)
            end = begin + part.num_rows
            targets[begin:end] = np.reshape(part["target"].combine_chunks().flatten().to_numpy(), (-1, 3))
            solved[begin:end] = np.array(part["status"].to_pylist()) == "solved"
            begin = end
            if begin == rows:
                break
        for axis, (i, j) in zip(axes[:2], ((0, 1), (0, 2)), strict=True):
            for mask, color, word in ((solved, "tab:blue", "solved"), (~solved, "tab:red", "not solved")):
                axis.scatter(*targets[mask][:, [i, j]].T, s=3, color=color, label=word)
            axis.set_xlabel("xyz"[i] + " [m]")
            axis.set_ylabel("xyz"[j] + " [m]")
            axis.set_aspect("equal", adjustable="datalim")
        axes[0].legend(fontsize=7)
    else:
        series = [c for c in dataset.columns if c.frames and c.counted and not c.name.endswith("time")]
        for axis, column in zip(axes[:2], series, strict=False):
            for row in range(min(3, rows)):
                axis.plot(np.reshape(dataset[row][column.name], (-1, max(1, column.size)))[:, :_LONG], lw=0.6)
            axis.set_xlabel("frame")
            axis.set_ylabel(f"{column.name} [{column.unit}]" if column.unit else column.name)
    counts = dataset.statuses
    axes[2].barh(list(counts), list(counts.values()), color="tab:gray")
    axes[2].set_xlabel("rows")
    content = io.BytesIO()
    figure.canvas.print_png(content)
    return content.getvalue()
