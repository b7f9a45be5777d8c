"""The university exercise (TP4, course ROB312 of ENSTA): its settings, runs, tables and conclusions."""
