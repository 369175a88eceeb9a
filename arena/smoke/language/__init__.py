"""The scenario language: text to frozen data."""
