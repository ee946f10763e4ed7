"""Thousands of records of hundreds of valves over years: computed once each, kept in one store, looked at together."""
