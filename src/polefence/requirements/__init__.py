"""Requirements on signals and on the law, one file a kind.

A kind says what moves its signal, what bounds it in an LMI, what is claimed, what a sample of it
is, and how a spec writes it. `text.KINDS` lists them.
"""
