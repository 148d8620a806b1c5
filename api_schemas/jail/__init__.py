"""The jail of every child process that touches what a user sent: a policy, a conversion, the verification of a log.

A child calls ``enter`` with what it needs, tells its parent how closed the jail is, and only then looks at what a user sent.
Robots and services both need this and may not know each other, so that it lives beside what they say to each other; it imports
nothing but the standard library (``report.py`` excepted), because it is part of how long a policy takes to start.
"""
