"""Learn where a person wants things on a table, and bound how wrong that is.

The packages, each importing only from those after it: `experiments`, `recording` and
`planner`, `scene`, `reward`, `irl`. Nothing heavy is imported here.
"""

__version__ = "0.1.0"
