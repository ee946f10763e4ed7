"""What would be read of a record, how is it reduced, and what is missing?"""
