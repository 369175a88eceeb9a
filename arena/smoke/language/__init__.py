"""The scenario language: text to frozen data. Our own parser: see `tokens` and `grammar`."""
