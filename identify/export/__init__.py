"""How does a fitted valve get into another program: an FMU of C sources, tables, tables of results?"""
