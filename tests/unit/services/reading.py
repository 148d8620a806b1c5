"""Keeps what is read from a database."""

from sqlalchemy import event


class Reading:
    """Keeps the statements that the readers of a database are asked, with their parameters."""

    def __init__(self, database):
        self.asked = []
        self._engine = database._readers.sync_engine

    def __enter__(self):
        event.listen(self._engine, "before_cursor_execute", self._note)
        return self

    def __exit__(self, *_):
        event.remove(self._engine, "before_cursor_execute", self._note)

    def _note(self, _connection, _cursor, statement, parameters, *_):
        self.asked.append((statement, parameters))
