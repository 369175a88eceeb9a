"""Live web page of a running arena, made with viser: `arena monitor`. The arena also runs without this process."""
