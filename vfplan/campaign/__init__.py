"""How sure is a plan: many trials of it, each with other errors, and what they say together.

A leaf room: no other package imports it, but for `--margin p=P`. Its command is `vfplan campaign`.

trial       what a campaign varies, and one trial: how far the tool came
store       a folder of blocks that a later run goes on with, made here or on a Dask cluster; the
            trials' probabilities, quantiles and margins with their intervals, and their picture
"""
