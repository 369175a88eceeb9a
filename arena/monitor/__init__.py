"""Live page of a running arena, made with viser: `arena monitor`. Nobody in the arena needs this process."""
