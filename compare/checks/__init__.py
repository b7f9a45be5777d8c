"""Laws that a filter must obey, each on small recordings whose answer is known."""
