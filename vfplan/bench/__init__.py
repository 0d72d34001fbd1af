"""Error against run time, for every stage: `pipeline.bench()` measures, `figures` draws.

record      what is measured, side by side, and how it is written down; the Pareto front
proxy       stage proxy: scenes with known truth, methods, settings
peers       what a user would pick instead: a penalty force, and outside programs
pipeline    stages extract, sample, register and plan; all stages as one JSON document; the machine
"""
