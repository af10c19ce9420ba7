"""The sub-commands of ``haptogram``: arguments -> a call -> text and files.

Each has ``set_up``, which describes it and adds its options, and ``run``.  Importing one costs
nothing; heavy parts are imported when it runs.  No physics, wire or verdict lives here.
"""
