"""What `benchmarks/faults.py` does to commands, and how it tells what came of it.

`commands` lists them and what they are given, `machine` runs one and looks at what it said and left, `storage` takes
its room and its rights, `processes` kills it, its workers and its scheduler, `foreign_files` puts files of others in
its way.
"""
