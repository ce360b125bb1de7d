"""The actions of menus, keys and buttons."""
