"""The report of the conformance suite: page, JUnit XML, JSON, text; several devices compared."""
