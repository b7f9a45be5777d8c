"""The noise of a recording: `slamgauge noise`."""

from __future__ import annotations

import sys
from contextlib import nullcontext

from slamgauge.compare.cli.options.recordings import Noise
from slamgauge.compare.cli.steps import draw, results_folder, write_page
from slamgauge.compare.noise.estimation import find_noise
from slamgauge.compare.noise.noise_json import noise_json
from slamgauge.compare.noise.tables import noise_page
from slamgauge.compare.scoring.comparison import digest
from slamgauge.compare.storage.files import load_recording, save, write_json
from slamgauge.compare.storage.result_files import NOISE
from slamgauge.compare.storage.staged_folder import staged_files
from slamgauge.errors import UserError


def run(command: Noise) -> int:
    """Run the command; return the exit status."""
    recording = load_recording(command.recording)
    if command.write is not None and command.write.resolve() == command.recording.resolve():
        raise UserError(f"{command.write}: is the recording itself; give another --write")
    staged = nullcontext() if command.write is None else staged_files(command.write.parent, [command.write.name])
    with staged as parent, results_folder(command.out, NOISE) as folder:
        noise = find_noise(recording, systematic=command.systematic, heading=command.heading)
        content = noise_json(noise) | {"digest": digest(recording)}
        command.output.show(content, noise_page(content))
        if folder is not None:
            write_json(folder / NOISE, content)
        if command.write is not None and parent is not None:
            save(parent / command.write.name, noise.tuned)
    done = True
    if command.out is not None:
        done = draw(command.out, NOISE)
    for place in filter(None, (command.out, command.write)):
        print(f"written to {place}", file=sys.stderr)
    return 0 if write_page(command.out, NOISE, command.page) and done else 1
