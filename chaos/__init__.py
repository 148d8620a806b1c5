"""The program that breaks a farm of its own on purpose and checks that the farm kept its promises; nobody imports it."""
