"""The sub-commands of ``haptogram``: arguments -> a call -> text and files.

Each has ``set_up_NAME``, which describes it and adds its options, and ``run_NAME``.  Importing one
costs nothing; heavy parts are imported when it runs.  No physics, wire or verdict lives here.
"""
