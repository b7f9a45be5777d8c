"""The map and its book-keeping: which landmarks there are, where they stand in the state, what corrects them."""
