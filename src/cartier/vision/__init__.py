"""Visual question answering about the objects of a home: vision models, one file each, found through cartier.plugins.

``attributes.py`` reads what is asked about, ``views.py`` selects the views, ``crops.py`` makes the pictures,
``decision.py`` says what follows from a reply.
"""
