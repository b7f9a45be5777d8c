"""Checks that every right filter passes, on small recordings with a known answer."""
