"""What will tests that are yet to be run show, and what will they not tell apart?"""
