"""What the workflow's rules call: parse, load, call one function, save.

Every step runs by itself, ``python -m silmesh.steps.fit --help``; a rule starts it by
``python -m silmesh.steps fit``, which begins sooner where a process waits for it.
"""
