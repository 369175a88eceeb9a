"""The contract script's parts: the comparison, one vehicle under test, the cases, what is known to differ."""
