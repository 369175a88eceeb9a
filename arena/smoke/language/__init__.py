"""The scenario language: converts the text of a scenario file to frozen dataclasses.

See `tokens` and `grammar`.
"""
