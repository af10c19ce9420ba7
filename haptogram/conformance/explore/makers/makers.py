"""The makers of one dialogue, which share its conditions."""

from __future__ import annotations

from .conditions import DialogueConditions
from .configurations import RandomConfigs
from .requests import RandomRequests
from .sessions import RandomSessions
from .stream import RandomStream


class DialogueMakers:
    """The makers of one dialogue.

    Parameters
    ----------
    conditions : DialogueConditions
        Conditions of the dialogue.

    Attributes
    ----------
    conditions : DialogueConditions
        The same.
    configs, stream, requests, sessions
        Makers of configurations, stream frames, requests, and HELLO with what belongs to sessions.
    """

    def __init__(self, conditions: DialogueConditions) -> None:
        self.conditions = conditions
        self.configs = RandomConfigs(conditions)
        self.stream = RandomStream(conditions)
        self.requests = RandomRequests(conditions, self.configs)
        self.sessions = RandomSessions(conditions)
