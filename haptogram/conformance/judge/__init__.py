"""Judgements that several cases share: drives, foci, mutes by a timer, refusals, recovery.

Beside them lies what they need: events with their effects, requests to be refused or repeated.

A judgement that one clause needs lies in the clause's case.
"""
