"""The services of the farm: API, dispatcher, database and files, in one or more processes. None loads physics or learning."""
