"""JSON Schemas (draft 2020-12) of the JSON that commands print and write; files only."""
