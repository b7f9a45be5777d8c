"""The map of a filter and its book-keeping: slots, ids, growth, tracks."""
