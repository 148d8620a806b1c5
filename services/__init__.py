"""The services of the farm: API, dispatcher, database and files, in one process. Never loads physics or learning."""
