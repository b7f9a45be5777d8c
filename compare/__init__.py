"""Filters compared with the optimum on the same measurements: scenarios, scores, studies, figures, command line.

The public names are those of `slamgauge` itself.
"""

import slamgauge


def __getattr__(name: str) -> object:
    if name in slamgauge.names_of("compare"):
        return getattr(slamgauge, name)
    raise AttributeError(f"module 'slamgauge.compare' has no attribute {name!r}")


def __dir__() -> list[str]:
    return slamgauge.names_of("compare")
