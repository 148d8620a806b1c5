"""A second generator of blind cases for ``trifarm gap study``, written from the documents alone; see the README beside it."""
