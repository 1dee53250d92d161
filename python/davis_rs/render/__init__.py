"""How to render: the table kernel and Mitsuba's integrators behind one interface."""
