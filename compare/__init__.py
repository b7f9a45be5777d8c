"""Filters compared with the optimum on the same measurements: scenarios, scores, studies, figures, command line.

The public names are those of `slamgauge` itself.
"""
