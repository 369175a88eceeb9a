"""Live web page of a running arena, made with viser: `arena monitor`. No other process needs this process."""
