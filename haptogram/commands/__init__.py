"""The sub-commands of ``haptogram``: one module each, with ``add`` (arguments) and ``run``.

Importing one costs nothing; what is heavy is imported when it runs.
"""
