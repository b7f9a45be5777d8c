"""Forms of user code, one module each; `adapters` lists them."""
