"""Files of others whose names are unlucky."""

from __future__ import annotations

import random

from mishaps.machine import Machine, Tried, contents

UNLUCKY = (  # as ours, nearly as ours, or as no program likes them
    *(
        "figure.png~",
        "metrics.json.bak",
        ".slamgauge.0badcafe.partial/owner",
        ".slamgauge.json.partial",
        "study.sqlite2",
    ),
    *("estimates/mine.npz", "trajectories/gps.tum", "association.gate=9/notes", "optimum/notes", "studies/notes"),
    *("-rf", "~", "$HOME", "`id`", "a\nb", "bad\udcff", "<b>&amp;.html", "submissions/me.md", "CON", " ", "%s%n", "*"),
)


def foreign(machine: Machine, name: str, count: int, contents_of: random.Random) -> Tried:
    """A folder with files of others whose names are unlucky: whatever the command says, they stay as they are."""
    out = machine.place()
    words = machine.words(name, out)
    for number in range(count):
        unlucky = UNLUCKY[number % len(UNLUCKY)]
        path = out / (unlucky if number < len(UNLUCKY) else f"{unlucky} {number}")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(contents_of.randbytes(64))
    before = contents(out)
    for _ in range(2):
        outcome = machine.end(machine.start(words))
        after = contents(out)
        yield outcome if {each: after.get(each) for each in before} == before else "lost"
