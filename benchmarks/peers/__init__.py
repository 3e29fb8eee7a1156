"""Other people's tools on the same problems: ``python -m benchmarks.peers`` and ``python -m benchmarks.peers.sindy``.

They come with the extra ``peers``, which neither the tests nor flexarm need.
"""
