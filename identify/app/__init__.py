"""How does a folder that is dropped on a page become a fit or a diagnosis? (the extra `app`; no JAX)"""
