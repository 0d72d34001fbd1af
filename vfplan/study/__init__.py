"""What judges the build, not a user's plan: scenes with known truth, the bench, extreme cases.

Imported by `bench`, `stability` and `demo`, by the samples and by the tests; by nothing that a
robot's user runs.
"""
