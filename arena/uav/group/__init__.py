"""The process that runs the user programs of a group of vehicles."""
