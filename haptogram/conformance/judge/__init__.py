"""Judgements that several cases share: drives, foci, mutes by a timer, refusals, recovery.

A judgement that one clause needs lies in the clause's case.
"""
