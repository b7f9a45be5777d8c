"""What the JSON of commands and files is made of, as JSON Schemas (draft 2020-12)."""
