"""Plan tests and studies: the expected information of tests, and the size of a study."""
