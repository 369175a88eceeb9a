"""The scenario language: parser from the text of a scenario file to frozen data. See `tokens` and `grammar`."""
