"""Error against run time, for every stage: `stages.bench()` measures, `figures` draws.

record      what is measured, side by side, and how it is written down; the Pareto front
pipeline    stages extract, sample, register and plan: scenes with known truth, methods, settings
proxy       stage proxy: the same
peers       what a user would pick instead: a penalty force, and outside programs
stages      all stages as one JSON document; the machine
"""
