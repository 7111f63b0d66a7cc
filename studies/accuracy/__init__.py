"""What accuracy costs in time: error against a converged reference beside the measured cost of a tick.

A study is one module in `sweeps`, found by its name; `study.py` says what it has to have.
"""
