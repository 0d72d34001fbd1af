"""Replay a session against a fixture: what the controller would have rendered, and how it went.

The engine is the controller's own core, stepped sample by sample, never by a clock: the same
session and fixture give the same bits on every run.

replay      the whole way: load, run, report
guiding, link, changing
            what stands in the engine's place, before it, or changes it
clearance, metrics
            what is measured at each tick, and over the session
findings    what the numbers are held against, and the verdict
"""
