"""What people may choose: settings of the filters, with their defaults and rules."""
