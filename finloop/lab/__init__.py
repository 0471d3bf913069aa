"""A lab's own repository, whose pipeline calls the installed finloop: `finloop new FOLDER`.

`files.txt` lists the files of finloop that a lab gets; a wheel takes them along. `template/` holds
what a lab's repository has of its own.
"""
