"""What a folder of results holds, to compare it with another one."""

import csv
import json

import numpy as np


def read_folder(folder):
    """Read all that does not depend on how fast the machine is."""
    content = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.suffix == ".csv":
            with path.open(newline="") as file:
                rows = list(csv.DictReader(file))
            content[name] = [
                {k: v for k, v in row.items() if not k.endswith("seconds")}
                for row in rows
            ]
        elif path.suffix == ".json" and name != "config.json":
            content[name] = json.loads(path.read_text()) | {"seconds": None}
        elif path.suffix == ".npz":
            content[name] = {k: v.tolist() for k, v in np.load(path).items()}
        else:
            content[name] = None
    return content
