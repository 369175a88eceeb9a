"""No tests, to be deleted with `arena/sim/scalar_step.py`: tests/sim/test_hand_over.py tests the motion of small fleets."""
