"""How do two records of one valve, or of two valves on one bench, differ?"""
