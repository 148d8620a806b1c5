"""The jail of every child process that touches uploads: a policy, a conversion, the verification of a log.

A child calls ``enter`` with its needs, tells its parent how closed the jail is, and only then reads what was uploaded. Robots and
services both use it. It imports nothing but the standard library, because it is part of how long a policy takes to start.
"""
